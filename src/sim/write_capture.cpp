#include <algorithm>
#include <string>

#include "src/sim/simulator.hpp"

namespace bolo::sim {
namespace {

// What the frames were made with, as root attributes beside the format's own.
Status write_settings(capture::CaptureWriter& writer, const CameraSettings& settings) {
  const bool bolometer = settings.kind == CameraKind::kBolometer;
  Status status = writer.write_attribute("simulated_camera", std::string(bolometer ? "bolometer" : "visible"));
  const auto add = [&](const char* name, double value) {
    if (status) status = writer.write_attribute(name, value);
  };
  if (bolometer) {
    add("simulated_tau_s", settings.tau_s);
  } else {
    add("simulated_exposure_s", settings.exposure_s);
  }
  add("simulated_noise_k", settings.readout.noise_k);
  add("simulated_quantisation_k", settings.readout.quantisation_k);
  if (status) status = writer.write_attribute("simulated_seed", std::to_string(settings.readout.seed));
  return status;
}

}  // namespace

Status write_capture(Simulator& simulator, const OutputFile& file, const CaptureOptions& options,
                     const std::function<bool(std::size_t)>& progress) {
  const CameraSettings& settings = simulator.settings();
  capture::CaptureInfo info;
  info.format = simulator.format();
  info.camera_model = "Bolo simulator";
  info.camera_serial = "seed-" + std::to_string(settings.camera_seed.value_or(settings.readout.seed));
  info.has_truth = options.truth;
  capture::WriterOptions how;
  how.truth = options.truth;
  how.deflate_level = options.deflate_level;
  how.replace = file.replace;
  auto writer = capture::CaptureWriter::create(file.path, info, how);
  if (!writer) return tl::unexpected(writer.error());
  const double last_s = static_cast<double>(std::max<std::size_t>(options.frames, 2) - 1) / settings.rate_hz;
  Status status = writer->write_stimulus(simulator.field().stimulus(-history_s(settings), last_s));
  if (status) status = write_settings(*writer, settings);

  std::vector<std::byte> plane(plane_bytes(info.format.geometry, info.format.type));
  std::vector<float> truth(options.truth ? info.format.geometry.pixels() : 0);
  float* const truth_plane = options.truth ? truth.data() : nullptr;
  for (std::size_t k = 0; status && k < options.frames; ++k) {
    simulator.next(plane.data(), truth_plane);
    status = writer->append(static_cast<double>(k) / settings.rate_hz, k, plane.data(), truth_plane);
    if (status && !progress(k + 1)) break;
  }
  return status ? writer->close() : status;
}

}  // namespace bolo::sim

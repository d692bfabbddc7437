#include <cstddef>
#include <memory>
#include <mutex>
#include <utility>
#include <variant>

#include "src/sim/simulator.hpp"
#include "src/sim/stimulus_error.hpp"
#include "tools/lab/blind/captures.hpp"

namespace bolo::tools::blind {
namespace {

constexpr double kRateHz = 200.0;

// The HDF5 library is not made for two threads.
std::mutex& hdf5_mutex() {
  static std::mutex mutex;
  return mutex;
}

std::unique_ptr<const sim::Field> nominal_field(const capture::Stimulus& stimulus) {
  if (const auto* uniform = std::get_if<capture::Uniform>(&stimulus)) return sim::make_uniform(uniform->temperature_k);
  if (const auto* chopper = std::get_if<capture::Chopper>(&stimulus)) return sim::make_chopper(*chopper);
  return sim::make_bars(std::get<capture::BarTarget>(stimulus));
}

sim::CameraSettings camera_of(const Session& session, const CapturePlan& plan) {
  sim::CameraSettings camera;
  camera.geometry = session.geometry;
  camera.rate_hz = kRateHz;
  camera.readout.seed = plan.noise_seed;
  camera.threads = 1;
  camera.effects = plan.effects;
  camera.camera_seed = session.camera_seed;
  camera.session_start_s = plan.session_start_s;
  return camera;
}

// All frames one after another.
Result<std::vector<std::byte>> simulated(sim::Simulator& simulator, std::size_t frames, const GoOn& go_on) {
  const StreamFormat format = simulator.format();
  const std::size_t bytes = plane_bytes(format.geometry, format.type);
  std::vector<std::byte> planes(bytes * frames);
  for (std::size_t k = 0; k < frames; ++k) {
    if (!go_on()) return failed("interrupted");
    simulator.next(planes.data() + k * bytes, nullptr);
  }
  return planes;
}

// Without the attributes that sim::write_capture() adds: they tell seeds.
Status write_file(const std::filesystem::path& file, const StreamFormat& format, const CapturePlan& plan,
                  const std::vector<std::byte>& planes) {
  const std::lock_guard lock(hdf5_mutex());
  capture::CaptureInfo info;
  info.format = format;
  info.camera_model = "camera";
  auto writer = capture::CaptureWriter::create(file, info);
  if (!writer) return tl::unexpected(writer.error());
  Status status = writer->write_stimulus(plan.stimulus);
  const std::size_t bytes = plane_bytes(format.geometry, format.type);
  for (std::size_t k = 0; status && k < plan.frames; ++k) {
    status = writer->append(static_cast<double>(k) / kRateHz, k, planes.data() + k * bytes);
  }
  return status ? writer->close() : status;
}

Status write_capture(const Session& session, const CapturePlan& plan, const std::filesystem::path& file,
                     const GoOn& go_on) {
  auto field = sim::with_errors(nominal_field(plan.stimulus), plan.faults, session.geometry);
  if (!field) return tl::unexpected(field.error());
  const auto simulator = sim::Simulator::create(camera_of(session, plan), std::move(*field));
  if (!simulator) return tl::unexpected(simulator.error());
  const auto planes = simulated(**simulator, plan.frames, go_on);
  if (!planes) return tl::unexpected(planes.error());
  return write_file(file, (*simulator)->format(), plan, *planes);
}

}  // namespace

Result<std::vector<std::filesystem::path>> write_captures(const Session& session, const std::filesystem::path& folder,
                                                          const GoOn& go_on) {
  std::vector<std::filesystem::path> files;
  for (const CapturePlan& plan : session.captures) {
    files.push_back(folder / plan.file);
    const Status status = write_capture(session, plan, files.back(), go_on);
    if (!status) return tl::unexpected(status.error());
  }
  return files;
}

}  // namespace bolo::tools::blind

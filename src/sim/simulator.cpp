#include "src/sim/simulator.hpp"

#include <algorithm>
#include <cmath>
#include <string>

#include "src/sim/effect_camera.hpp"

namespace bolo::sim {
namespace {

constexpr double kMemory = 14.0;  // time constants; exp(-14) is under a millionth

bool within(double value, double low, double high) { return value >= low && value <= high; }

// Message about the first invalid setting; empty if all are valid.
std::string fault(const CameraSettings& s) {
  const ReadoutSettings& r = s.readout;
  if (s.geometry.width < 1 || s.geometry.width > 16384) return "width must be 1 to 16384 pixels";
  if (s.geometry.height < 1 || s.geometry.height > 16384) return "height must be 1 to 16384 pixels";
  if (!within(s.rate_hz, 0.1, 1e5)) return "rate must be 0.1 to 100000 Hz";
  if (!within(s.tau_s, 1e-6, 10.0)) return "tau must be 0.000001 to 10 s";
  if (!within(r.noise_k, 0.0, 1000.0)) return "noise must be 0 to 1000 K";
  if (!within(r.quantisation_k, 0.0, 100.0)) return "quantisation must be 0 to 100 K";
  if (r.type == PixelType::kUint16 && r.quantisation_k == 0.0) return "quantisation 0 needs the type float32";
  if (!within(s.threads, 1, 64)) return "threads must be 1 to 64";
  if (!within(s.session_start_s, 0.0, 1e6)) return "the session's start must be 0 to 1000000 s";
  if (!s.effects.empty() && s.tau_s < 1e-4) return "with effects tau must be 0.0001 to 10 s";
  if (const Status effects = check_effects(s.effects); !effects) return effects.error().message;
  return {};
}

// Writes the camera's settings, as root attributes beside the format's own.
Status write_settings(capture::CaptureWriter& writer, const CameraSettings& settings) {
  return writer.write_attributes({{"simulated_tau_s", settings.tau_s},
                                  {"simulated_noise_k", settings.readout.noise_k},
                                  {"simulated_quantisation_k", settings.readout.quantisation_k},
                                  {"simulated_seed", std::to_string(settings.readout.seed)}});
}

}  // namespace

LinearScale readout_scale(const ReadoutSettings& settings) {
  if (settings.type == PixelType::kFloat32) return {Unit::kKelvin, 1.0, 0.0};
  return {Unit::kKelvin, settings.quantisation_k, 0.0};
}

void read_row(const ReadoutSettings& settings, std::span<const double> kelvin, void* out) noexcept {
  if (settings.type == PixelType::kUint16) {
    auto* values = static_cast<std::uint16_t*>(out);
    for (std::size_t x = 0; x < kelvin.size(); ++x) {
      const double steps = std::clamp(kelvin[x] / settings.quantisation_k + 0.5, 0.0, 65535.0);
      values[x] = static_cast<std::uint16_t>(steps);
    }
    return;
  }
  auto* values = static_cast<float*>(out);
  const double step = settings.quantisation_k;
  for (std::size_t x = 0; x < kelvin.size(); ++x) {
    values[x] = static_cast<float>(step > 0.0 ? std::round(kelvin[x] / step) * step : kelvin[x]);
  }
}

Result<CameraSettings> checked(const CameraSettings& settings) {
  if (const std::string what = fault(settings); !what.empty()) return bad_input(what);
  return settings;
}

double history_s(const CameraSettings& settings) { return kMemory * settings.tau_s; }

Result<std::unique_ptr<Simulator>> Simulator::create(const CameraSettings& settings,
                                                     std::unique_ptr<const Field> field) {
  RETURN_IF_ERROR(checked(settings));
  const double highest_k = 65535.0 * settings.readout.quantisation_k;
  if (settings.readout.type == PixelType::kUint16 && field->extremes().high_k > highest_k) {
    return bad_input("16 bits of " + std::to_string(settings.readout.quantisation_k) + " K reach only " +
                     std::to_string(highest_k) + " K, the scene has " + std::to_string(field->extremes().high_k) +
                     " K; take a coarser quantisation or the type float32");
  }
  std::unique_ptr<Simulator> simulator(new Simulator(settings, std::move(field)));
  RETURN_IF_ERROR(simulator->team_.status());
  return simulator;
}

Simulator::Simulator(const CameraSettings& settings, std::unique_ptr<const Field> field)
    : settings_(settings),
      field_(std::move(field)),
      team_(settings.threads, rt::ThreadOptions{"bolo-sim", 0, {}}),
      camera_(std::make_unique<EffectCamera>(settings_, *field_, team_)) {}

Simulator::~Simulator() = default;

StreamFormat Simulator::format() const {
  const ReadoutSettings& readout = settings_.readout;
  return {settings_.geometry, readout.type, readout_scale(readout), 1.0 / settings_.rate_hz, 1};
}

void Simulator::next(void* plane, float* truth) {
  camera_->next(plane);
  const auto width = static_cast<std::size_t>(settings_.geometry.width);
  for (int row = 0; truth != nullptr && row < settings_.geometry.height; ++row) {
    field_->sample(static_cast<double>(frame_) / settings_.rate_hz, row,
                   {truth + static_cast<std::size_t>(row) * width, width});
  }
  ++frame_;
}

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
  ASSIGN_OR_RETURN(auto writer, capture::CaptureWriter::create(file.path, info, how));
  const double last_s = static_cast<double>(std::max<std::size_t>(options.frames, 2) - 1) / settings.rate_hz;
  Status status = writer.write_stimulus(simulator.field().stimulus(-history_s(settings), last_s));
  if (status) status = write_settings(writer, settings);

  std::vector<std::byte> plane(plane_bytes(info.format.geometry, info.format.type));
  std::vector<float> truth(options.truth ? info.format.geometry.pixels() : 0);
  float* const truth_plane = options.truth ? truth.data() : nullptr;
  for (std::size_t k = 0; status && k < options.frames; ++k) {
    simulator.next(plane.data(), truth_plane);
    status = writer.append(static_cast<double>(k) / settings.rate_hz, k, plane.data(), truth_plane);
    if (status && !progress(k + 1)) break;
  }
  return status ? writer.close() : status;
}

}  // namespace bolo::sim

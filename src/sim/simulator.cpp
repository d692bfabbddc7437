#include "src/sim/simulator.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <string>

#include <Eigen/Core>

#include "src/sim/effect_camera.hpp"
#include "src/sim/random.hpp"

namespace bolo::sim {
namespace {

constexpr double kMemory = 14.0;  // time constants; exp(-14) is under a millionth

Eigen::Map<const Eigen::ArrayXf> as_array(const std::vector<float>& row) {
  return {row.data(), static_cast<Eigen::Index>(row.size())};
}

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

// m[k] = integral over s from 0 to 1 of z exp(-z (1 - s)) s^k: the answer to T_ss = s^k after a step of z = h / tau.
std::array<double, 3> moments(double z) noexcept {
  std::array<double, 3> m{};
  if (z > 0.5) {
    m[0] = -std::expm1(-z);
    m[1] = 1.0 - m[0] / z;
    m[2] = 1.0 - 2.0 * m[1] / z;
    return m;
  }
  // The differences above cancel for small z; the series m[k] = sum over j of -(-z)^(j+1) k! / (k + j + 1)! does not.
  constexpr int kTerms = 14;  // 0.5^14 / 15! is below the last bit
  for (int k = 0; k < 3; ++k) {
    double term = z / (k + 1);
    for (int j = 1; j <= kTerms; ++j) {
      m[static_cast<std::size_t>(k)] += term;
      term *= -z / (k + 1 + j);
    }
  }
  return m;
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

void read_row(const ReadoutSettings& settings, std::uint64_t frame, int row, std::span<double> kelvin,
              std::span<double> noise, void* out) noexcept {
  if (settings.noise_k > 0.0) {
    fill_normal(settings.seed, frame, static_cast<std::uint64_t>(row), noise);
    for (std::size_t x = 0; x < kelvin.size(); ++x) kelvin[x] += settings.noise_k * noise[x];
  }
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

StepWeights bolometer_step(double duration_s, double tau_s) noexcept {
  const double z = duration_s / tau_s;
  const auto m = moments(z);
  // The quadratic through the three values: (2s^2 - 3s + 1) start + (4s - 4s^2) middle + (2s^2 - s) end.
  return {std::exp(-z), 2.0 * m[2] - 3.0 * m[1] + m[0], 4.0 * (m[1] - m[2]), 2.0 * m[2] - m[1]};
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
      shown_(settings.geometry.pixels()),
      scratch_(static_cast<std::size_t>(settings.threads)),
      team_(settings.threads, rt::ThreadOptions{"bolo-sim", 0, {}}) {
  const auto width = static_cast<std::size_t>(settings.geometry.width);
  for (Scratch& scratch : scratch_) {
    for (std::vector<float>* row : {&scratch.start, &scratch.middle, &scratch.end}) row->resize(width);
    for (std::vector<double>* row : {&scratch.kelvin, &scratch.noise}) row->resize(width);
  }
  if (!settings_.effects.empty()) effects_ = std::make_unique<EffectCamera>(settings_, *field_, team_);
}

Simulator::~Simulator() = default;

StreamFormat Simulator::format() const {
  const ReadoutSettings& readout = settings_.readout;
  return {settings_.geometry, readout.type, readout_scale(readout), 1.0 / settings_.rate_hz, 1};
}

void Simulator::next(void* plane, float* truth) {
  if (effects_ != nullptr) return next_with_effects(plane, truth);
  plane_ = plane;
  truth_ = truth;
  plan();
  team_.run(
      team_.size(), [](void* self, int part) { static_cast<Simulator*>(self)->work(part); }, this);
  ++frame_;
}

// The truth is the scene at the nominal time, without the camera's effects.
void Simulator::next_with_effects(void* plane, float* truth) {
  effects_->next(plane);
  const auto width = static_cast<std::size_t>(settings_.geometry.width);
  for (int row = 0; truth != nullptr && row < settings_.geometry.height; ++row) {
    field_->sample(static_cast<double>(frame_) / settings_.rate_hz, row,
                   {truth + static_cast<std::size_t>(row) * width, width});
  }
  ++frame_;
}

// A pixel goes on from the frame before.
void Simulator::plan() {
  const double to_s = static_cast<double>(frame_) / settings_.rate_hz;
  const double before_s = (static_cast<double>(frame_) - 1.0) / settings_.rate_hz;
  from_s_ = frame_ > 0 ? before_s : to_s - history_s(settings_);
  instants_.clear();
  field_->instants(from_s_, to_s, settings_.tau_s, instants_);
  steps_.clear();
  double start_s = from_s_;
  for (const double end_s : instants_) {
    const double h = end_s - start_s;
    steps_.push_back({start_s + h / 2.0, end_s, bolometer_step(h, settings_.tau_s)});
    start_s = end_s;
  }
}

void Simulator::work(int part) noexcept {
  const int first = settings_.geometry.height * part / settings_.threads;
  const int end = settings_.geometry.height * (part + 1) / settings_.threads;
  Scratch& scratch = scratch_[static_cast<std::size_t>(part)];
  for (int row = first; row < end; ++row) {
    integrate(row, scratch);
    read_out(row, scratch);
  }
}

// Brings the row from from_s_ to the frame's time; leaves T_ss at that time in scratch.start. Sums are kept in double:
// a float near 300 K would stand still when a short step changes it by less than its last bit.
void Simulator::integrate(int row, Scratch& scratch) noexcept {
  const std::size_t width = scratch.start.size();
  Eigen::Map<Eigen::ArrayXd> shown(shown_.data() + static_cast<std::size_t>(row) * width,
                                   static_cast<Eigen::Index>(width));
  field_->sample(from_s_, row, scratch.start);
  if (frame_ == 0) shown = as_array(scratch.start).cast<double>();  // steady state
  for (const Step& step : steps_) {
    field_->sample(step.middle_s, row, scratch.middle);
    field_->sample(step.end_s, row, scratch.end);
    const auto start = static_cast<float>(step.weights.start);
    const auto middle = static_cast<float>(step.weights.middle);
    const auto end = static_cast<float>(step.weights.end);
    const auto input =
        start * as_array(scratch.start) + middle * as_array(scratch.middle) + end * as_array(scratch.end);
    shown = step.weights.keep * shown + input.cast<double>();
    scratch.start.swap(scratch.end);
  }
}

void Simulator::read_out(int row, Scratch& scratch) noexcept {
  const std::size_t width = scratch.start.size();
  const std::size_t offset = static_cast<std::size_t>(row) * width;
  if (truth_ != nullptr) {
    std::ranges::copy(scratch.start, truth_ + offset);
  }
  std::copy_n(shown_.data() + offset, width, scratch.kelvin.data());
  read_row(settings_.readout, frame_, row, scratch.kelvin, scratch.noise,
           static_cast<std::byte*>(plane_) + offset * bytes_of(settings_.readout.type));
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

#include "src/sim/simulator.hpp"

#include <algorithm>
#include <cmath>
#include <deque>
#include <limits>
#include <string>

#include "src/sim/pixel_band.hpp"
#include "src/sim/radiance.hpp"

namespace bolo::sim {
namespace {

// Memory of a pixel in time constants (exp(-14) < 1e-6), and that of its slow part.
constexpr double kMemory = 14.0;
constexpr double kSlowMemory = 8.0;

bool within(double value, double low, double high) { return value >= low && value <= high; }

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

// Writes the camera's settings as root attributes beside the format's own.
Status write_settings(capture::CaptureWriter& writer, const CameraSettings& settings) {
  return writer.write_attributes({{"simulated_tau_s", settings.tau_s},
                                  {"simulated_noise_k", settings.readout.noise_k},
                                  {"simulated_quantisation_k", settings.readout.quantisation_k},
                                  {"simulated_seed", std::to_string(settings.readout.seed)}});
}

// With effects, the squared step length is this many times that for kStepToleranceK: errors stay within 3 mK, a tenth
// of a camera's noise.
constexpr double kPatience = 4.0;

CameraModel nominal(const CameraSettings& settings) {
  CameraModel model;
  model.geometry = settings.geometry;
  model.period_s = 1.0 / settings.rate_hz;
  model.tau_s.assign(settings.geometry.pixels(), settings.tau_s);
  model.row_delay_s.assign(static_cast<std::size_t>(settings.geometry.height), 0.0);
  return model;
}

class BareView final : public View {
 public:
  explicit BareView(const Field& field) : field_(field) {}
  explicit BareView(std::unique_ptr<const Field> owned) : owned_(std::move(owned)), field_(*owned_) {}
  std::unique_ptr<View> blurred(const Blur& blur) const override {
    std::unique_ptr<const Field> field = field_.blurred(blur);
    return field == nullptr ? nullptr : std::make_unique<BareView>(std::move(field));
  }
  void draw(double t_s, const Patch& patch, std::span<float> out) override {
    const auto width = static_cast<std::size_t>(patch.width);
    for (int y = 0; y < patch.height; ++y) {
      field_.sample_from(t_s, patch.column, patch.row + y, out.subspan(static_cast<std::size_t>(y) * width, width));
    }
  }

 private:
  std::unique_ptr<const Field> owned_;  // nullptr when the field is borrowed
  const Field& field_;
};

}  // namespace

// The camera with its effects: scene -> optics -> pixels -> read-out -> firmware -> transport.
class EffectCamera {
 public:
  // Borrows settings, field and team. The settings must be checked. Thread: setup.
  EffectCamera(const CameraSettings& settings, const Field& field, rt::WorkerTeam& team)
      : settings_(settings),
        field_(field),
        team_(team),
        effects_(make_effects(settings, field.extremes())),
        model_(nominal(settings)),
        noise_(static_cast<std::size_t>(settings.threads)),
        frame_(plane_bytes(settings.geometry, settings.readout.type)) {
    for (auto& row : noise_) row.resize(static_cast<std::size_t>(settings.geometry.width));
    for (const PlacedEffect& placed : effects_) placed.effect->configure(model_);

    // Rows coupled by conduction must be integrated together.
    const int count = model_.coupling != 0.0 ? 1 : settings.threads;
    const int height = settings.geometry.height;
    bands_.reserve(static_cast<std::size_t>(count));
    for (int i = 0; i < count; ++i) {
      std::unique_ptr<View> view = std::make_unique<BareView>(field);
      for (const PlacedEffect& placed : effects_) view = placed.effect->filter_view(std::move(view), model_);
      bands_.emplace_back(model_, std::move(view), height * i / count, height * (i + 1) / count);
    }

    const double fastest_s = *std::ranges::min_element(model_.tau_s);
    const bool bends = model_.coupling != 0.0 || model_.falling_scale != 1.0;
    longest_step_s_ = bends ? fastest_s / 12.0 : std::numeric_limits<double>::infinity();
    const auto [earliest, latest] = std::ranges::minmax(model_.row_delay_s);
    const double spread_s = latest - earliest + model_.window_s + 2.0 * model_.look_ahead_s;
    look_ahead_ = static_cast<std::int64_t>(std::ceil(spread_s / model_.period_s)) + 1;
    taken_ = planned_ = -model_.warm_up_frames;
  }

  // The next frame sent, in the settings' type. Thread: one at a time.
  void next(void* plane) {
    int frames = 1;
    for (const PlacedEffect& placed : effects_) frames += placed.effect->frames_lost(sent_);
    if (sent_ == 0) {
      frames = std::max(frames, 1);
      for (int i = 0; i < model_.warm_up_frames; ++i) take();
    }
    for (int i = 0; i < frames; ++i) take();
    ++sent_;
    std::copy(frame_.begin(), frame_.end(), static_cast<std::byte*>(plane));
  }

 private:
  // A frame being taken: its rows are filled in at their read times.
  struct Flight {
    FrameInstant instant;
    double last_s = 0.0;  // read time of its last row
    std::vector<double> shown;
    std::vector<double> opened;  // integrals at the start of each row's window
  };

  void take() {
    while (planned_ <= taken_ + look_ahead_) plan_flight();
    const Flight& flight = flights_.front();
    if (!settled_) settle(probes_.front().t_s);
    plan_steps(flight.last_s);
    team_.run(team_.size(), integrate_job, this);
    std::erase_if(probes_, [this](const Probe& probe) { return probe.t_s <= now_s_; });
    for (const PlacedEffect& placed : effects_) placed.effect->begin(flight.instant);
    team_.run(team_.size(), render_job, this);
    flights_.pop_front();
    ++taken_;
  }

  void plan_flight() {
    Flight& flight = flights_.emplace_back();
    const double nominal_s = static_cast<double>(planned_) * model_.period_s;
    double t_s = nominal_s;
    for (const PlacedEffect& placed : effects_) t_s += placed.effect->shift_s(planned_, nominal_s);
    flight.instant = {planned_, t_s, settings_.session_start_s + t_s};
    flight.shown.resize(model_.geometry.pixels());
    if (model_.window_s > 0.0) flight.opened.resize(flight.shown.size());
    const auto width = static_cast<std::size_t>(model_.geometry.width);
    flight.last_s = t_s;
    for (int row = 0; row < model_.geometry.height; ++row) {
      const auto y = static_cast<std::size_t>(row);
      Probe probe{t_s + model_.row_delay_s[y], row, false, flight.shown.data() + y * width, nullptr};
      flight.last_s = std::max(flight.last_s, probe.t_s);
      if (model_.window_s > 0.0) {
        probe.open = flight.opened.data() + y * width;
        probes_.push_back({probe.t_s - model_.window_s, row, true, probe.out, probe.open});
      }
      probes_.push_back(probe);
    }
    std::ranges::stable_sort(probes_, {}, &Probe::t_s);
    ++planned_;
  }

  // The camera ran before the first frame. The distant past of a slow part is integrated in coarse steps.
  void settle(double first_s) {
    const double slowest_s = *std::ranges::max_element(model_.tau_s) * std::max(1.0, model_.falling_scale);
    const double fine_s = first_s - kMemory * slowest_s;
    const double begin_s =
        model_.slow_share != 0.0 ? std::min(fine_s, first_s - kSlowMemory * model_.slow_tau_s) : fine_s;
    now_s_ = begin_s;
    for (PixelBand& band : bands_) band.settle(begin_s);
    settled_ = true;
    if (begin_s == fine_s) return;
    steps_.clear();
    const double steps = std::ceil((fine_s - begin_s) / (slowest_s / 5.0));
    for (double i = 0.0; i < steps; i += 1.0) {
      steps_.push_back({begin_s + (fine_s - begin_s) * i / steps, begin_s + (fine_s - begin_s) * (i + 1.0) / steps});
    }
    team_.run(team_.size(), integrate_job, this);
    now_s_ = steps_.back().to_s;
  }

  // Plans the steps needed to read the frame's last row.
  void plan_steps(double to_s) {
    steps_.clear();
    if (to_s <= now_s_) return;
    instants_.clear();
    const double patience = effects_.empty() ? 1.0 : kPatience * bands_.front().patience();
    field_.instants(now_s_, to_s, settings_.tau_s * patience, instants_);
    for (const double instant_s : instants_) {
      ends_.clear();
      divide(now_s_, instant_s, longest_step_s_, ends_);
      for (const double end_s : ends_) steps_.push_back({std::exchange(now_s_, end_s), end_s});
    }
  }

  static void integrate_job(void* self, int part) {
    auto& camera = *static_cast<EffectCamera*>(self);
    const auto i = static_cast<std::size_t>(part);
    if (i < camera.bands_.size()) camera.bands_[i].run(camera.steps_, camera.probes_);
  }

  static void render_job(void* self, int part) {
    auto& camera = *static_cast<EffectCamera*>(self);
    const int height = camera.model_.geometry.height;
    const int threads = camera.settings_.threads;
    for (int row = height * part / threads; row < height * (part + 1) / threads; ++row) {
      camera.render(row, camera.noise_[static_cast<std::size_t>(part)]);
    }
  }

  void render(int row, std::span<double> noise) noexcept {
    Flight& flight = flights_.front();
    const auto width = static_cast<std::size_t>(model_.geometry.width);
    const std::size_t offset = static_cast<std::size_t>(row) * width;
    const std::span<double> kelvin = std::span(flight.shown).subspan(offset, width);
    if (model_.radiance) std::ranges::transform(kelvin, kelvin.begin(), temperature_of);
    auto placed = effects_.begin();
    for (; placed != effects_.end() && placed->order <= Order::kOffset; ++placed) {
      placed->effect->row(flight.instant, row, kelvin);
    }
    add_noise(row, kelvin, noise);
    for (; placed != effects_.end(); ++placed) placed->effect->row(flight.instant, row, kelvin);
    read_row(settings_.readout, kelvin, frame_.data() + offset * bytes_of(settings_.readout.type));
  }

  void add_noise(int row, std::span<double> kelvin, std::span<double> noise) const noexcept {
    const ReadoutSettings& readout = settings_.readout;
    const double rms_k = readout.noise_k * model_.noise_scale;
    if (!(rms_k > 0.0)) return;
    const auto frame = static_cast<std::uint64_t>(flights_.front().instant.index);
    if (model_.noise_degrees > 0.0) {
      fill_student(key(key(name_key("student", readout.seed), frame), static_cast<std::uint64_t>(row)),
                   model_.noise_degrees, noise);
    } else {
      fill_normal(readout.seed, frame, static_cast<std::uint64_t>(row), noise);
    }
    for (std::size_t x = 0; x < kelvin.size(); ++x) kelvin[x] += rms_k * noise[x];
  }

  const CameraSettings& settings_;
  const Field& field_;
  rt::WorkerTeam& team_;
  std::vector<PlacedEffect> effects_;
  CameraModel model_;
  std::vector<PixelBand> bands_;
  std::vector<std::vector<double>> noise_;  // one row per worker

  std::uint64_t sent_ = 0;
  std::int64_t taken_ = 0;    // index of the next frame to take
  std::int64_t planned_ = 0;  // index of the next frame to plan
  std::int64_t look_ahead_ = 1;
  std::deque<Flight> flights_;  // from taken_ to planned_ - 1
  double now_s_ = 0.0;
  double longest_step_s_ = 0.0;
  bool settled_ = false;
  std::vector<double> instants_;  // of the field
  std::vector<double> ends_;      // step ends up to one of these
  std::vector<StepSpan> steps_;
  std::vector<Probe> probes_;     // not read yet, sorted by time
  std::vector<std::byte> frame_;  // last frame taken, as sent
};

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
    if (status && !progress(k + 1) && k + 1 < options.frames) return writer.complete();
  }
  if (!status) writer.discard();  // a partial file is useless: the same seed reproduces all of it
  return status ? writer.close() : status;
}

}  // namespace bolo::sim

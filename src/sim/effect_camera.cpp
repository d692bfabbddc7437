#include "src/sim/effect_camera.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

#include "src/sim/radiance.hpp"

namespace bolo::sim {
namespace {

// Time constants that a pixel, and a slow part of it, remember; see Simulator.
constexpr double kTimeConstants = 14.0;
constexpr double kSlowMemory = 8.0;
// Steps are so many times longer, squared, than kStepToleranceK asks for: within 3 mK, a tenth of a camera's noise.
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
  std::unique_ptr<const Field> owned_;  // nullptr when the field is lent
  const Field& field_;
};

}  // namespace

EffectCamera::EffectCamera(const CameraSettings& settings, const Field& field, rt::WorkerTeam& team)
    : settings_(settings),
      field_(field),
      team_(team),
      effects_(make_effects(settings, field.extremes())),
      model_(nominal(settings)),
      silent_(settings.readout),
      noise_(static_cast<std::size_t>(settings.threads)),
      frame_(plane_bytes(settings.geometry, settings.readout.type)) {
  silent_.noise_k = 0.0;
  for (auto& row : noise_) row.resize(static_cast<std::size_t>(settings.geometry.width));
  for (const PlacedEffect& placed : effects_) placed.effect->configure(model_);

  // Rows that touch each other through conduction are stepped together.
  const int count = model_.coupling != 0.0 ? 1 : settings.threads;
  const int height = settings.geometry.height;
  bands_.reserve(static_cast<std::size_t>(count));
  for (int i = 0; i < count; ++i) {
    std::unique_ptr<View> view = std::make_unique<BareView>(field);
    for (const PlacedEffect& placed : effects_) view = placed.effect->look(std::move(view), model_);
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

void EffectCamera::next(void* plane) {
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

void EffectCamera::take() {
  while (planned_ <= taken_ + look_ahead_) plan_flight();
  const Flight& flight = flights_.front();
  if (!settled_) settle(probes_.front().t_s);
  plan_steps(flight.last_s);
  team_.run(integrate_job, this);
  std::erase_if(probes_, [this](const Probe& probe) { return probe.t_s <= now_s_; });
  for (const PlacedEffect& placed : effects_) placed.effect->begin(flight.instant);
  team_.run(render_job, this);
  flights_.pop_front();
  ++taken_;
}

void EffectCamera::plan_flight() {
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

// The camera was already looking. What a slow part remembers from long ago is taken in coarse steps.
void EffectCamera::settle(double first_s) {
  const double slowest_s = *std::ranges::max_element(model_.tau_s) * std::max(1.0, model_.falling_scale);
  const double fine_s = first_s - kTimeConstants * slowest_s;
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
  team_.run(integrate_job, this);
  now_s_ = steps_.back().to_s;
}

// Steps from now on, so that the last row of the frame can be read.
void EffectCamera::plan_steps(double to_s) {
  steps_.clear();
  if (to_s <= now_s_) return;
  instants_.clear();
  field_.instants(now_s_, to_s, settings_.tau_s * kPatience * bands_.front().patience(), instants_);
  for (const double instant_s : instants_) {
    divide(now_s_, instant_s);
    now_s_ = instant_s;
  }
}

void EffectCamera::divide(double from_s, double to_s) {
  const double parts = std::max(1.0, std::ceil((to_s - from_s) / longest_step_s_));
  double before_s = from_s;
  for (double i = 1.0; i < parts; i += 1.0) {
    const double here_s = from_s + (to_s - from_s) * (i / parts);
    steps_.push_back({before_s, here_s});
    before_s = here_s;
  }
  steps_.push_back({before_s, to_s});
}

void EffectCamera::integrate_job(void* self, int worker) {
  auto& camera = *static_cast<EffectCamera*>(self);
  const auto i = static_cast<std::size_t>(worker);
  if (i < camera.bands_.size()) camera.bands_[i].run(camera.steps_, camera.probes_);
}

void EffectCamera::render_job(void* self, int worker) {
  auto& camera = *static_cast<EffectCamera*>(self);
  const int height = camera.model_.geometry.height;
  const int threads = camera.settings_.threads;
  for (int row = height * worker / threads; row < height * (worker + 1) / threads; ++row) {
    camera.render(row, camera.noise_[static_cast<std::size_t>(worker)]);
  }
}

void EffectCamera::render(int row, std::span<double> noise) noexcept {
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
  read_row(silent_, 0, row, kelvin, noise, frame_.data() + offset * bytes_of(silent_.type));
}

void EffectCamera::add_noise(int row, std::span<double> kelvin, std::span<double> noise) const noexcept {
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

}  // namespace bolo::sim

#include "src/sim/effect_camera.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "src/sim/radiance.hpp"

namespace bolo::sim {
namespace {

// m_k = integral over s from 0 to 1 of z exp(-z (1 - s)) s^k: a pixel's response to x = s^k, with z = h / tau.
struct Moments {
  double m0, m1, m2;
};

// For z up to kShort: the series of m2; m1 and m0 follow without cancellation. Good to 1e-9.
constexpr double kShort = 0.3;
inline Moments short_moments(double z) noexcept {
  const double m2 =
      z * (1.0 / 3 - z * (1.0 / 12 - z * (1.0 / 60 - z * (1.0 / 360 - z * (1.0 / 2520 - z * (1.0 / 20160))))));
  const double m1 = 0.5 * z * (1.0 - m2);
  return {z * (1.0 - m1), m1, m2};
}

inline Moments long_moments(double z) noexcept {
  const double m0 = -std::expm1(-z);
  const double m1 = 1.0 - m0 / z;
  return {m0, m1, 1.0 - 2.0 * m1 / z};
}

// The quadratic through three values of a step, from its beginning to the part `f` of it.
struct Quadratic {
  double start, slope, bend;
  Quadratic(float a, float m, float b, double f) noexcept
      : start(static_cast<double>(a)),
        slope(f * (4.0 * static_cast<double>(m) - 3.0 * static_cast<double>(a) - static_cast<double>(b))),
        bend(2.0 * f * f * (static_cast<double>(a) - 2.0 * static_cast<double>(m) + static_cast<double>(b))) {}
  double mean() const noexcept { return start + slope / 2.0 + bend / 3.0; }
};

inline double answer(const Quadratic& x, const Moments& m, double before) noexcept {
  return before + m.m0 * (x.start - before) + m.m1 * x.slope + m.m2 * x.bend;
}

template <typename MomentsOf>
void answer_row(std::span<const float> a, std::span<const float> m, std::span<const float> b, double h, double f,
                const double* rate, double* shown, MomentsOf moments) noexcept {
  for (std::size_t i = 0; i < a.size(); ++i) {
    shown[i] = answer(Quadratic(a[i], m[i], b[i], f), moments(h * rate[i]), shown[i]);
  }
}

inline Moments moments(double z) noexcept { return z <= kShort ? short_moments(z) : long_moments(z); }

// Time constants that a pixel, and a slow part of it, remember; see Simulator.
constexpr double kTimeConstants = 14.0;
constexpr double kSlowMemory = 8.0;
// With effects steps are so many times longer, squared, than kStepToleranceK asks for: within 3 mK, a tenth of a
// camera's noise.
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

PixelBand::PixelBand(const CameraModel& model, std::unique_ptr<View> view, int first_row, int end_row)
    : model_(model),
      view_(std::move(view)),
      first_row_(first_row),
      patch_{0.0, first_row, model.geometry.width, end_row - first_row},
      width_(static_cast<std::size_t>(model.geometry.width)) {
  const std::size_t size = patch_.points();
  const bool slow = model.slow_share != 0.0;
  for (std::vector<float>* plane : {&seen_.start, &seen_.middle, &seen_.end}) plane->resize(size);
  if (model.coupling != 0.0) {
    for (std::vector<float>* plane : {&driven_.start, &driven_.middle, &driven_.end, &flow_, &flow_end_})
      plane->resize(size);
    ahead_.resize(size);
    input_ = &driven_;
  }
  rate_.resize(size);
  fast_.resize(size);
  row_fast_.resize(width_);
  if (slow) slow_.resize(size);
  if (slow) row_slow_.resize(width_);
  if (model.window_s > 0.0) sum_.resize(size);
  if (model.window_s > 0.0) row_sum_.resize(width_);
  const auto skip = static_cast<std::size_t>(first_row) * width_;
  for (std::size_t i = 0; i < size; ++i) rate_[i] = 1.0 / model.tau_s[skip + i];
}

void PixelBand::settle(double t_s) {
  view_->draw(t_s, patch_, seen_.end);
  std::ranges::copy(seen_.end, fast_.begin());
  if (!slow_.empty()) slow_ = fast_;
  std::ranges::fill(sum_, 0.0);
}

void PixelBand::run(std::span<const StepSpan> steps, std::span<const Probe> probes) {
  if (patch_.height == 0) return;  // more workers than rows
  std::size_t next = 0;
  for (const StepSpan& span : steps) {
    const std::size_t first = next;
    while (next < probes.size() && probes[next].t_s <= span.to_s) ++next;
    step(span, probes.subspan(first, next - first));
  }
}

void PixelBand::step(const StepSpan& span, std::span<const Probe> probes) {
  const double h = span.to_s - span.from_s;
  seen_.start.swap(seen_.end);
  view_->draw(span.from_s + h / 2.0, patch_, seen_.middle);
  view_->draw(span.to_s, patch_, seen_.end);
  if (model_.falling_scale != 1.0) choose_rates();
  if (model_.coupling != 0.0) add_conduction(h);
  for (const Probe& probe : probes) {
    if (probe.row >= first_row_ && probe.row < first_row_ + patch_.height) read(probe, span);
  }
  advance(h, 1.0, 0, fast_.size(), fast_.data(), slow_.data(), sum_.empty() ? nullptr : sum_.data());
}

// A pixel cools when what it sees is colder than what it shows.
void PixelBand::choose_rates() {
  const double* const tau_s = model_.tau_s.data() + static_cast<std::size_t>(first_row_) * width_;
  for (std::size_t i = 0; i < rate_.size(); ++i) {
    const bool falls = static_cast<double>(seen_.middle[i]) < fast_[i];
    rate_[i] = 1.0 / (falls ? tau_s[i] * model_.falling_scale : tau_s[i]);
  }
}

// Conduction as an input beside T_ss, a straight line from its value at the beginning to the one at the end that the
// first value foresees: the exponential Runge-Kutta method of second order (Hochbruck and Ostermann, Acta Numerica
// 2010, section 2.4).
void PixelBand::add_conduction(double h) {
  const auto add = [this](const std::vector<float>& last) {
    for (std::size_t i = 0; i < flow_.size(); ++i) {
      driven_.start[i] = seen_.start[i] + flow_[i];
      driven_.middle[i] = seen_.middle[i] + 0.5F * (flow_[i] + last[i]);
      driven_.end[i] = seen_.end[i] + last[i];
    }
  };
  conduct(fast_, flow_);
  add(flow_);
  ahead_ = fast_;
  advance(h, 1.0, 0, ahead_.size(), ahead_.data(), nullptr, nullptr);
  conduct(ahead_, flow_end_);
  add(flow_end_);
}

void PixelBand::conduct(const std::vector<double>& shown, std::vector<float>& out) const {
  const auto coupling = static_cast<float>(model_.coupling);
  const auto add = [&](int y, int dy, int dx) {
    if (y + dy < 0 || y + dy >= patch_.height) return;
    const double* const own = shown.data() + static_cast<std::size_t>(y) * width_;
    const double* const other = shown.data() + static_cast<std::size_t>(y + dy) * width_;
    float* const to = out.data() + static_cast<std::size_t>(y) * width_;
    const int last = patch_.width - std::max(dx, 0);
    for (int x = std::max(-dx, 0); x < last; ++x) to[x] += coupling * static_cast<float>(other[x + dx] - own[x]);
  };
  std::ranges::fill(out, 0.0F);
  for (int y = 0; y < patch_.height; ++y) {
    for (const int d : {-1, 1}) {
      add(y, d, 0);
      add(y, 0, d);
      if (model_.neighbours != 8) continue;
      add(y, d, -1);
      add(y, d, 1);
    }
  }
}

// Brings `count` pixels from `first` on through the part `part` of a step h. `fast`, `slow` and `sum` are theirs.
void PixelBand::advance(double h, double part, std::size_t first, std::size_t count, double* fast, double* slow,
                        double* sum) const {
  const double h_part = h * part;
  const auto a = std::span(input_->start).subspan(first, count);
  const auto m = std::span(input_->middle).subspan(first, count);
  const auto b = std::span(input_->end).subspan(first, count);
  const double* const rate = rate_.data() + first;
  const double share = model_.slow_share;
  if (sum != nullptr) {  // tau dT/dt = x - T: the integral of T is that of x, less tau times the change
    for (std::size_t i = 0; i < count; ++i) {
      sum[i] += h_part * Quadratic(a[i], m[i], b[i], part).mean() + (1.0 - share) / rate[i] * fast[i];
      if (share != 0.0) sum[i] += share * model_.slow_tau_s * slow[i];
    }
  }
  const auto [slowest, fastest] = std::minmax_element(rate, rate + count);
  if (*slowest == *fastest) {
    answer_row(a, m, b, h_part, part, rate, fast, [same = moments(h_part * *rate)](double) { return same; });
  } else {
    answer_row(a, m, b, h_part, part, rate, fast, moments);
  }
  if (slow != nullptr) {
    const Moments of_slow = moments(h_part / model_.slow_tau_s);
    for (std::size_t i = 0; i < count; ++i) slow[i] = answer(Quadratic(a[i], m[i], b[i], part), of_slow, slow[i]);
  }
  if (sum != nullptr) {
    for (std::size_t i = 0; i < count; ++i) {
      sum[i] -= (1.0 - share) / rate[i] * fast[i];
      if (share != 0.0) sum[i] -= share * model_.slow_tau_s * slow[i];
    }
  }
}

// The row goes on from the step's beginning to the probe's time, aside.
void PixelBand::read(const Probe& probe, const StepSpan& span) {
  const auto first = static_cast<std::size_t>(probe.row - first_row_) * width_;
  const auto begin = static_cast<std::ptrdiff_t>(first);
  const double h = span.to_s - span.from_s;
  std::copy_n(fast_.begin() + begin, width_, row_fast_.begin());
  if (!slow_.empty()) std::copy_n(slow_.begin() + begin, width_, row_slow_.begin());
  if (!sum_.empty()) std::copy_n(sum_.begin() + begin, width_, row_sum_.begin());
  advance(h, (probe.t_s - span.from_s) / h, first, width_, row_fast_.data(), slow_.empty() ? nullptr : row_slow_.data(),
          sum_.empty() ? nullptr : row_sum_.data());
  if (probe.open != nullptr) {
    if (probe.opens) {
      std::ranges::copy(row_sum_, probe.open);
      return;
    }
    for (std::size_t i = 0; i < width_; ++i) probe.out[i] = (row_sum_[i] - probe.open[i]) / model_.window_s;
    return;
  }
  const double share = model_.slow_share;
  for (std::size_t i = 0; i < width_; ++i) {
    probe.out[i] = share != 0.0 ? (1.0 - share) * row_fast_[i] + share * row_slow_[i] : row_fast_[i];
  }
}

EffectCamera::EffectCamera(const CameraSettings& settings, const Field& field, rt::WorkerTeam& team)
    : settings_(settings),
      field_(field),
      team_(team),
      effects_(make_effects(settings, field.extremes())),
      model_(nominal(settings)),
      noise_(static_cast<std::size_t>(settings.threads)),
      frame_(plane_bytes(settings.geometry, settings.readout.type)) {
  for (auto& row : noise_) row.resize(static_cast<std::size_t>(settings.geometry.width));
  for (const PlacedEffect& placed : effects_) placed.effect->configure(model_);

  // Rows that touch each other through conduction are stepped together.
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
  team_.run(team_.size(), integrate_job, this);
  std::erase_if(probes_, [this](const Probe& probe) { return probe.t_s <= now_s_; });
  for (const PlacedEffect& placed : effects_) placed.effect->begin(flight.instant);
  team_.run(team_.size(), render_job, this);
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

// The camera was running before the first frame. The distant past of a slow part is integrated in coarse steps.
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
  team_.run(team_.size(), integrate_job, this);
  now_s_ = steps_.back().to_s;
}

// Steps from now on, so that the last row of the frame can be read.
void EffectCamera::plan_steps(double to_s) {
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

void EffectCamera::integrate_job(void* self, int part) {
  auto& camera = *static_cast<EffectCamera*>(self);
  const auto i = static_cast<std::size_t>(part);
  if (i < camera.bands_.size()) camera.bands_[i].run(camera.steps_, camera.probes_);
}

void EffectCamera::render_job(void* self, int part) {
  auto& camera = *static_cast<EffectCamera*>(self);
  const int height = camera.model_.geometry.height;
  const int threads = camera.settings_.threads;
  for (int row = height * part / threads; row < height * (part + 1) / threads; ++row) {
    camera.render(row, camera.noise_[static_cast<std::size_t>(part)]);
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
  read_row(settings_.readout, kelvin, frame_.data() + offset * bytes_of(settings_.readout.type));
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

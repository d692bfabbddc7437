// A band of rows of the pixel array, integrated in time; each row is read at its own time.
//
// tau dT/dt = x - T - k sum over neighbours (T - T_n)     T   fast part of the pixel's temperature
// tau2 dS/dt = x - S                                      S   slow part, share a: output is (1 - a) T + a S
//   x   T_ss, a quadratic of time within a step             k   conduction
#pragma once

#include <algorithm>
#include <cmath>
#include <memory>
#include <span>
#include <utility>
#include <vector>

#include "src/sim/effect_type.hpp"

namespace bolo::sim {

// A row to be read. With integration, the row's first probe opens the window and the second closes it.
struct Probe {
  double t_s = 0.0;
  int row = 0;
  bool opens = false;
  double* out = nullptr;   // the row's values
  double* open = nullptr;  // integral up to the window's start; nullptr without a window
};

struct StepSpan {
  double from_s = 0.0;
  double to_s = 0.0;
};

class PixelBand {
 public:
  // Rows first_row to end_row - 1 of the model's array. Thread: setup.
  PixelBand(const CameraModel& model, std::unique_ptr<View> view, int first_row, int end_row)
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

  // Sets the steady state at t. Thread: one at a time.
  void settle(double t_s) {
    view_->draw(t_s, patch_, seen_.end);
    std::ranges::copy(seen_.end, fast_.begin());
    if (!slow_.empty()) slow_ = fast_;
    std::ranges::fill(sum_, 0.0);
  }

  // Integrates the steps in order, and reads rows at their probes (sorted by time). Thread: one at a time.
  void run(std::span<const StepSpan> steps, std::span<const Probe> probes) {
    if (patch_.height == 0) return;  // more workers than rows
    std::size_t next = 0;
    for (const StepSpan& span : steps) {
      const std::size_t first = next;
      while (next < probes.size() && probes[next].t_s <= span.to_s) ++next;
      step(span, probes.subspan(first, next - first));
    }
  }

  double patience() const { return view_->patience(); }

 private:
  // m_k = integral over s from 0 to 1 of z exp(-z (1 - s)) s^k: a pixel's response to x = s^k, with z = h / tau.
  struct Moments {
    double m0, m1, m2;
  };

  // For z <= kShort: series of m2; m1 and m0 follow without cancellation. Accurate to 1e-9.
  static constexpr double kShort = 0.3;
  static Moments short_moments(double z) noexcept {
    const double m2 =
        z * (1.0 / 3 - z * (1.0 / 12 - z * (1.0 / 60 - z * (1.0 / 360 - z * (1.0 / 2520 - z * (1.0 / 20160))))));
    const double m1 = 0.5 * z * (1.0 - m2);
    return {z * (1.0 - m1), m1, m2};
  }

  static Moments long_moments(double z) noexcept {
    const double m0 = -std::expm1(-z);
    const double m1 = 1.0 - m0 / z;
    return {m0, m1, 1.0 - 2.0 * m1 / z};
  }

  // The quadratic through three values of a step, from its start over the fraction `f` of it.
  struct Quadratic {
    double start, slope, bend;
    Quadratic(float a, float m, float b, double f) noexcept
        : start(static_cast<double>(a)),
          slope(f * (4.0 * static_cast<double>(m) - 3.0 * static_cast<double>(a) - static_cast<double>(b))),
          bend(2.0 * f * f * (static_cast<double>(a) - 2.0 * static_cast<double>(m) + static_cast<double>(b))) {}
    double mean() const noexcept { return start + slope / 2.0 + bend / 3.0; }
  };

  static double answer(const Quadratic& x, const Moments& m, double before) noexcept {
    return before + m.m0 * (x.start - before) + m.m1 * x.slope + m.m2 * x.bend;
  }

  template <typename MomentsOf>
  static void answer_row(std::span<const float> a, std::span<const float> m, std::span<const float> b, double h,
                         double f, const double* rate, double* shown, MomentsOf moments) noexcept {
    for (std::size_t i = 0; i < a.size(); ++i) {
      shown[i] = answer(Quadratic(a[i], m[i], b[i], f), moments(h * rate[i]), shown[i]);
    }
  }

  static Moments moments(double z) noexcept { return z <= kShort ? short_moments(z) : long_moments(z); }

  void step(const StepSpan& span, std::span<const Probe> probes) {
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

  // A pixel cools when its input is colder than the pixel.
  void choose_rates() {
    const double* const tau_s = model_.tau_s.data() + static_cast<std::size_t>(first_row_) * width_;
    for (std::size_t i = 0; i < rate_.size(); ++i) {
      const bool falls = static_cast<double>(seen_.middle[i]) < fast_[i];
      rate_[i] = 1.0 / (falls ? tau_s[i] * model_.falling_scale : tau_s[i]);
    }
  }

  // Adds conduction to T_ss, linear from its value at the start to the end value predicted from that: second-order
  // exponential Runge-Kutta method (Hochbruck and Ostermann, Acta Numerica 2010, section 2.4).
  void add_conduction(double h) {
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

  void conduct(const std::vector<double>& shown, std::vector<float>& out) const {
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

  // Advances `count` pixels from `first` on by the fraction `part` of a step h. `fast`, `slow` and `sum` are theirs.
  void advance(double h, double part, std::size_t first, std::size_t count, double* fast, double* slow,
               double* sum) const {
    const double h_part = h * part;
    const auto a = std::span(input_->start).subspan(first, count);
    const auto m = std::span(input_->middle).subspan(first, count);
    const auto b = std::span(input_->end).subspan(first, count);
    const double* const rate = rate_.data() + first;
    const double share = model_.slow_share;
    if (sum != nullptr) {  // tau dT/dt = x - T: the integral of T is that of x minus tau times the change
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

  // Advances a copy of the row from the step's start to the probe's time.
  void read(const Probe& probe, const StepSpan& span) {
    const auto first = static_cast<std::size_t>(probe.row - first_row_) * width_;
    const auto begin = static_cast<std::ptrdiff_t>(first);
    const double h = span.to_s - span.from_s;
    std::copy_n(fast_.begin() + begin, width_, row_fast_.begin());
    if (!slow_.empty()) std::copy_n(slow_.begin() + begin, width_, row_slow_.begin());
    if (!sum_.empty()) std::copy_n(sum_.begin() + begin, width_, row_sum_.begin());
    advance(h, (probe.t_s - span.from_s) / h, first, width_, row_fast_.data(),
            slow_.empty() ? nullptr : row_slow_.data(), sum_.empty() ? nullptr : row_sum_.data());
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

  struct Inputs {
    std::vector<float> start;
    std::vector<float> middle;
    std::vector<float> end;
  };

  const CameraModel& model_;
  std::unique_ptr<View> view_;
  int first_row_;
  Patch patch_;
  std::size_t width_;
  Inputs seen_;                   // T_ss at the step's start, middle and end
  Inputs driven_;                 // the same with conduction
  const Inputs* input_ = &seen_;  // input of the pixels: seen_ or driven_
  std::vector<float> flow_;       // conduction at the step's start
  std::vector<float> flow_end_;   // predicted conduction at its end
  std::vector<double> rate_;      // 1 / tau in this step
  std::vector<double> fast_;
  std::vector<double> slow_;  // empty without a slow part
  std::vector<double> sum_;   // integral of the output; empty without a window
  std::vector<double> ahead_;
  std::vector<double> row_fast_;
  std::vector<double> row_slow_;
  std::vector<double> row_sum_;
};

}  // namespace bolo::sim

// Fields without an image: uniform, chopper and bars, ideal or with the errors of a real bench.
#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>

#include "src/sim/stimulus_error.hpp"

namespace bolo::sim {
namespace {

// Longest step in which a kink (dT_ss/dt changes by `kink_k_s`) stays within kStepToleranceK; see SoftBars.
double longest_step_s(double kink_k_s, double response_s) {
  return kink_k_s > 0.0 ? std::sqrt(24.0 * kStepToleranceK * response_s / kink_k_s)
                        : std::numeric_limits<double>::infinity();
}

Extremes extremes_of(const capture::Chopper& chopper) {
  Extremes extremes{chopper.cold_k, chopper.cold_k};
  for (const double level_k : chopper.level_k) {
    extremes.low_k = std::min(extremes.low_k, level_k);
    extremes.high_k = std::max(extremes.high_k, level_k);
  }
  return extremes;
}

Extremes extremes_of(const capture::BarTarget& target) {
  return {std::min(target.cold_k, target.hot_k), std::max(target.cold_k, target.hot_k)};
}

class UniformField final : public Field {
 public:
  explicit UniformField(double temperature_k) : temperature_k_(temperature_k) {}

  void sample_from(double, double, int, std::span<float> out) const noexcept override {
    std::ranges::fill(out, static_cast<float>(temperature_k_));
  }
  void instants(double, double to_s, double, std::vector<double>& out) const override { out.push_back(to_s); }
  Extremes extremes() const override { return {temperature_k_, temperature_k_}; }
  std::unique_ptr<const Field> blurred(const Blur&) const override { return std::make_unique<UniformField>(*this); }
  capture::Stimulus stimulus(double, double) const override { return capture::Uniform{temperature_k_}; }

 private:
  double temperature_k_;
};

class ChopperField final : public Field {
 public:
  explicit ChopperField(capture::Chopper chopper) : chopper_(std::move(chopper)) {}

  void sample_from(double t_s, double, int, std::span<float> out) const noexcept override {
    std::ranges::fill(out, static_cast<float>(level(t_s)));
  }

  void instants(double from_s, double to_s, double, std::vector<double>& out) const override {
    const auto jump = [&](double t_s) {
      if (t_s <= from_s || t_s > to_s) return;
      const double before = std::nextafter(t_s, -std::numeric_limits<double>::infinity());
      if (before > from_s) out.push_back(before);
      out.push_back(t_s);
    };
    const auto first = std::upper_bound(chopper_.off_s.begin(), chopper_.off_s.end(), from_s);
    for (auto i = static_cast<std::size_t>(first - chopper_.off_s.begin()); i < chopper_.on_s.size(); ++i) {
      if (chopper_.on_s[i] > to_s) break;
      jump(chopper_.on_s[i]);
      jump(chopper_.off_s[i]);
    }
    if (out.empty() || out.back() < to_s) out.push_back(to_s);
  }

  Extremes extremes() const override { return extremes_of(chopper_); }
  std::unique_ptr<const Field> blurred(const Blur&) const override { return std::make_unique<ChopperField>(*this); }
  capture::Stimulus stimulus(double, double) const override { return chopper_; }

 private:
  double level(double t_s) const noexcept {
    const auto next = std::upper_bound(chopper_.on_s.begin(), chopper_.on_s.end(), t_s);
    if (next == chopper_.on_s.begin()) return chopper_.cold_k;
    const auto i = static_cast<std::size_t>(next - chopper_.on_s.begin()) - 1;
    return t_s < chopper_.off_s[i] ? chopper_.level_k[i] : chopper_.cold_k;
  }

  capture::Chopper chopper_;
};

class SweptChopper final : public Field {
 public:
  SweptChopper(capture::Chopper chopper, const StimulusError& error, int width)
      : chopper_(std::move(chopper)), sweep_s_(error.sweep_s), width_(width) {
    for (auto* times : {&chopper_.on_s, &chopper_.off_s}) {
      for (double& t_s : *times) t_s += error.start_s;
    }
    ramp_s_ = std::max(std::abs(sweep_s_) / width + error.softness_s, 1e-7);
  }

  void sample_from(double t_s, double column, int, std::span<float> out) const noexcept override {
    std::ranges::fill(out, static_cast<float>(chopper_.cold_k));
    for (std::size_t i = first_after(t_s - latest_s()); i < chopper_.on_s.size(); ++i) {
      if (chopper_.on_s[i] + earliest_s() > t_s) break;
      const double contrast = chopper_.level_k[i] - chopper_.cold_k;
      for (std::size_t x = 0; x < out.size(); ++x) {
        const double here_s = t_s - delay_s(column + static_cast<double>(x));
        out[x] += static_cast<float>(contrast * (open(here_s - chopper_.on_s[i]) - open(here_s - chopper_.off_s[i])));
      }
    }
  }

  // Fine steps while the blade is in view, none between.
  void instants(double from_s, double to_s, double response_s, std::vector<double>& out) const override {
    double contrast = 0.0;
    for (const double level_k : chopper_.level_k) contrast = std::max(contrast, std::abs(level_k - chopper_.cold_k));
    const double longest_s = longest_step_s(contrast / ramp_s_, response_s);
    double now_s = from_s;
    const auto pass = [&](double edge_s) {
      const double begin_s = std::min(edge_s + earliest_s(), to_s);
      const double end_s = std::min(edge_s + latest_s(), to_s);
      if (begin_s > now_s) {
        out.push_back(begin_s);
        now_s = begin_s;
      }
      if (end_s > now_s) {
        divide(now_s, end_s, longest_s, out);
        now_s = end_s;
      }
    };
    for (std::size_t i = first_after(from_s - latest_s()); i < chopper_.on_s.size() && now_s < to_s; ++i) {
      pass(chopper_.on_s[i]);
      pass(chopper_.off_s[i]);
    }
    if (now_s < to_s) out.push_back(to_s);
  }

  // Blur of a moving edge is blur in time, here of the ramp; only its variance matters to pixels a hundred times
  // slower.
  std::unique_ptr<const Field> blurred(const Blur& blur) const override {
    auto field = std::make_unique<SweptChopper>(*this);
    field->ramp_s_ = std::hypot(ramp_s_, std::sqrt(12.0) * blur.sigma_px * std::abs(sweep_s_) / width_);
    return field;
  }

  Extremes extremes() const override { return extremes_of(chopper_); }

  capture::Stimulus stimulus(double, double) const override { return chopper_; }

 private:
  // First pulse that ends after t.
  std::size_t first_after(double t_s) const noexcept {
    return static_cast<std::size_t>(std::ranges::upper_bound(chopper_.off_s, t_s) - chopper_.off_s.begin());
  }
  double delay_s(double column) const noexcept {
    const double way = (column + 0.5) / width_;
    return sweep_s_ >= 0.0 ? sweep_s_ * way : -sweep_s_ * (1.0 - way);
  }
  // Blurring optics also see columns outside the frame; the ramp extends a little further.
  double margin_s() const noexcept { return std::abs(sweep_s_) * kMarginPx / width_; }
  double earliest_s() const noexcept { return -ramp_s_ / 2.0 - margin_s(); }
  double latest_s() const noexcept { return std::abs(sweep_s_) + ramp_s_ / 2.0 + margin_s(); }
  double open(double since_s) const noexcept { return std::clamp(since_s / ramp_s_ + 0.5, 0.0, 1.0); }

  static constexpr double kMarginPx = 8.0;
  capture::Chopper chopper_;
  double sweep_s_;
  double width_;
  double ramp_s_ = 0.0;
};

// Response to an edge at distance d to the left: pixel mean of a step blurred by a Gaussian and a disc.
class EdgeProfile {
 public:
  EdgeProfile(double sigma, double radius) : reach_(0.5 + 5.0 * sigma + radius) {
    const auto half = static_cast<std::ptrdiff_t>(std::ceil(reach_ * kPointsPerPixel)) + 1;
    for (std::ptrdiff_t i = -half; i <= half; ++i) {
      values_.push_back(static_cast<float>(value(static_cast<double>(i) / kPointsPerPixel, sigma, radius)));
    }
    half_ = static_cast<double>(half);
  }
  double reach() const noexcept { return reach_; }
  float operator()(double d) const noexcept {
    if (d <= -reach_) return 0.0F;
    if (d >= reach_) return 1.0F;
    const double place = d * kPointsPerPixel + half_;
    const auto i = static_cast<std::size_t>(place);
    const auto part = static_cast<float>(place - static_cast<double>(i));
    return values_[i] + part * (values_[i + 1] - values_[i]);
  }

 private:
  // A disc's chords form a semicircle; the Gauss-Chebyshev rule of the second kind integrates its moments exactly.
  static double value(double d, double sigma, double radius) {
    if (radius <= 0.0) return risen(d + 0.5, sigma) - risen(d - 0.5, sigma);
    constexpr int kNodes = 64;
    double sum = 0.0;
    for (int i = 1; i <= kNodes; ++i) {
      const double angle = std::numbers::pi * i / (kNodes + 1);
      const double at = d - radius * std::cos(angle);
      sum += 2.0 / (kNodes + 1) * std::pow(std::sin(angle), 2) * (risen(at + 0.5, sigma) - risen(at - 0.5, sigma));
    }
    return sum;
  }
  // Integral up to z of the Gaussian-blurred step.
  static double risen(double z, double sigma) {
    if (sigma <= 0.0) return std::max(z, 0.0);
    const double u = z / sigma;
    const double density = std::exp(-0.5 * u * u) / std::sqrt(2.0 * std::numbers::pi);
    return sigma * (u * 0.5 * std::erfc(-u / std::numbers::sqrt2) + density);
  }
  static constexpr double kPointsPerPixel = 256.0;
  double reach_;
  double half_ = 0.0;
  std::vector<float> values_;
};

class SoftBars final : public Field {
 public:
  SoftBars(const capture::BarTarget& target, const StimulusError& error, double disc_px = 0.0)
      : target_(target), error_(error), disc_px_(disc_px), profile_(error.edge_px, disc_px) {}

  void sample_from(double t_s, double column, int row, std::span<float> out) const noexcept override {
    const auto contrast = static_cast<float>(target_.hot_k - target_.cold_k);
    const double shift = std::fmod(target_.slant_px_per_row * row + way_px(t_s) - column, target_.period_px);
    const double right_end = static_cast<double>(out.size()) - 0.5 + profile_.reach();
    const double first = shift - target_.period_px * (2.0 + std::ceil(profile_.reach() / target_.period_px));
    std::ranges::fill(out, static_cast<float>(target_.cold_k));
    for (double left = first; left < right_end; left += target_.period_px) {
      add_bar(left, left + target_.bar_width_px, contrast, out);
    }
  }

  // A pixel's T_ss is piecewise linear; its slope changes by at most contrast * velocity at each kink, when a sharp
  // edge enters or leaves it. Simpson's rule misjudges the area of a kink within a step h by at most slope change *
  // h^2/24, and the pixel spreads that over its response time.
  void instants(double from_s, double to_s, double response_s, std::vector<double>& out) const override {
    const double fastest = std::abs(target_.velocity_px_s * (1.0 + error_.velocity)) * (1.0 + std::abs(error_.uneven));
    divide(from_s, to_s, longest_step_s(std::abs(target_.hot_k - target_.cold_k) * fastest, response_s), out);
  }

  Extremes extremes() const override { return extremes_of(target_); }
  // A blur acts across the edge; along x it is sqrt(1 + slant^2) times as wide. At most one disc.
  std::unique_ptr<const Field> blurred(const Blur& blur) const override {
    const double along_x = blur.sigma_px * std::hypot(1.0, target_.slant_px_per_row);
    if (blur.disc) return disc_px_ > 0.0 ? nullptr : std::make_unique<SoftBars>(target_, error_, 2.0 * along_x);
    StimulusError softer = error_;
    softer.edge_px = std::hypot(error_.edge_px, along_x);
    return std::make_unique<SoftBars>(target_, softer, disc_px_);
  }
  capture::Stimulus stimulus(double, double) const override { return target_; }

 private:
  double way_px(double t_s) const noexcept {
    const double at_s = t_s - error_.start_s;
    const double turn = 2.0 * std::numbers::pi;
    const double swing_s = error_.uneven_period_s / turn;
    const double begin = turn * error_.uneven_phase;
    const double uneven_s =
        error_.uneven * swing_s * (std::cos(begin) - std::cos(turn * at_s / error_.uneven_period_s + begin));
    return target_.velocity_px_s * (1.0 + error_.velocity) * (at_s + uneven_s) + error_.phase * target_.period_px;
  }

  void add_bar(double left, double right, float contrast, std::span<float> out) const noexcept {
    const double size = static_cast<double>(out.size());
    const auto first = static_cast<std::size_t>(std::clamp(std::ceil(left - profile_.reach()), 0.0, size));
    const auto end = static_cast<std::size_t>(std::clamp(std::floor(right + profile_.reach()) + 1.0, 0.0, size));
    for (std::size_t i = first; i < end; ++i) {
      const double x = static_cast<double>(i);
      out[i] += contrast * (profile_(x - left) - profile_(x - right));
    }
  }

  capture::BarTarget target_;
  StimulusError error_;
  double disc_px_;  // radius of an additional disc blur of the edges along x
  EdgeProfile profile_;
};

}  // namespace

void divide(double from_s, double to_s, double longest_s, std::vector<double>& out) {
  const double steps = std::max(1.0, std::ceil((to_s - from_s) / longest_s));
  for (double i = 1.0; i < steps; i += 1.0) out.push_back(from_s + (to_s - from_s) * (i / steps));
  out.push_back(to_s);
}

std::unique_ptr<const Field> make_uniform(double temperature_k) {
  return std::make_unique<UniformField>(temperature_k);
}

std::unique_ptr<const Field> make_chopper(capture::Chopper chopper) {
  return std::make_unique<ChopperField>(std::move(chopper));
}

std::unique_ptr<const Field> make_bars(const capture::BarTarget& target) { return make_soft_bars(target, {}); }

std::unique_ptr<const Field> make_field(const capture::Stimulus& stimulus) {
  if (const auto* uniform = std::get_if<capture::Uniform>(&stimulus)) return make_uniform(uniform->temperature_k);
  if (const auto* chopper = std::get_if<capture::Chopper>(&stimulus)) return make_chopper(*chopper);
  return make_bars(std::get<capture::BarTarget>(stimulus));
}

std::unique_ptr<const Field> make_swept_chopper(capture::Chopper chopper, const StimulusError& error, int width) {
  return std::make_unique<SweptChopper>(std::move(chopper), error, width);
}

std::unique_ptr<const Field> make_soft_bars(const capture::BarTarget& target, const StimulusError& error) {
  return std::make_unique<SoftBars>(target, error);
}

}  // namespace bolo::sim

// Fields without a picture: uniform, chopper, bars.
#include <algorithm>
#include <cmath>
#include <limits>

#include "src/sim/field.hpp"
#include "src/sim/imperfect_fields.hpp"

namespace bolo::sim {
namespace {

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

  Extremes extremes() const override {
    Extremes extremes{chopper_.cold_k, chopper_.cold_k};
    for (const double level_k : chopper_.level_k) {
      extremes.low_k = std::min(extremes.low_k, level_k);
      extremes.high_k = std::max(extremes.high_k, level_k);
    }
    return extremes;
  }

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

class BarField final : public Field {
 public:
  explicit BarField(const capture::BarTarget& target) : target_(target) {}

  void sample_from(double t_s, double column, int row, std::span<float> out) const noexcept override {
    std::ranges::fill(out, static_cast<float>(target_.cold_k));
    const double contrast = target_.hot_k - target_.cold_k;
    const double shift =
        std::fmod(target_.slant_px_per_row * row + target_.velocity_px_s * t_s - column, target_.period_px);
    const double right_end = static_cast<double>(out.size()) - 0.5;
    for (double left = shift - 2.0 * target_.period_px; left < right_end; left += target_.period_px) {
      add_bar(left, contrast, out);
    }
  }

  // A pixel's T_ss is made of straight lines whose slope changes by contrast * velocity at each kink, when an edge
  // enters or leaves it. Simpson's rule misjudges the area of a kink within a step h by at most slope change * h^2 /
  // 24, and the pixel spreads it over its response time.
  void instants(double from_s, double to_s, double response_s, std::vector<double>& out) const override {
    const double kink = std::abs((target_.hot_k - target_.cold_k) * target_.velocity_px_s);
    const double longest_s =
        kink > 0.0 ? std::sqrt(24.0 * kStepToleranceK * response_s / kink) : std::numeric_limits<double>::infinity();
    const double steps = std::max(1.0, std::ceil((to_s - from_s) / longest_s));
    for (double i = 1.0; i < steps; i += 1.0) out.push_back(from_s + (to_s - from_s) * (i / steps));
    out.push_back(to_s);
  }

  Extremes extremes() const override {
    return {std::min(target_.cold_k, target_.hot_k), std::max(target_.cold_k, target_.hot_k)};
  }
  std::unique_ptr<const Field> blurred(const Blur& blur) const override {
    return make_soft_bars(target_, {})->blurred(blur);
  }
  capture::Stimulus stimulus(double, double) const override { return target_; }

 private:
  // Adds a bar from `left` on: the pixels at its ends by the share it covers of them.
  void add_bar(double left, double contrast, std::span<float> out) const noexcept {
    const double right = left + target_.bar_width_px;
    const auto first = static_cast<std::ptrdiff_t>(std::floor(left + 0.5));
    const auto last = static_cast<std::ptrdiff_t>(std::floor(right + 0.5));
    const auto size = static_cast<std::ptrdiff_t>(out.size());
    const auto add = [&](std::ptrdiff_t x, double share) {
      if (x >= 0 && x < size) out[static_cast<std::size_t>(x)] += static_cast<float>(contrast * share);
    };
    if (first == last) {
      add(first, target_.bar_width_px);
      return;
    }
    add(first, static_cast<double>(first) + 0.5 - left);
    add(last, right - (static_cast<double>(last) - 0.5));
    const auto inner = std::clamp<std::ptrdiff_t>(first + 1, 0, size);
    const auto inner_end = std::clamp<std::ptrdiff_t>(last, inner, size);
    std::fill(out.begin() + inner, out.begin() + inner_end, static_cast<float>(target_.hot_k));
  }

  capture::BarTarget target_;
};

}  // namespace

std::unique_ptr<const Field> make_uniform(double temperature_k) {
  return std::make_unique<UniformField>(temperature_k);
}

std::unique_ptr<const Field> make_chopper(capture::Chopper chopper) {
  return std::make_unique<ChopperField>(std::move(chopper));
}

std::unique_ptr<const Field> make_bars(const capture::BarTarget& target) { return std::make_unique<BarField>(target); }

}  // namespace bolo::sim

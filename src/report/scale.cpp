#include "src/report/scale.hpp"

#include <algorithm>
#include <cmath>

#include "src/report/text.hpp"

namespace bolo::plot {
namespace {

constexpr double kMargin = 0.05;  // of the span, on either side

// As many digits as the step asks for.
std::string linear_text(double value, double step, double largest) {
  if (largest >= 1e5 || step < 1e-4) return number_text(std::abs(value) < 1e-9 * step ? 0.0 : value);
  const int digits = std::max(0, static_cast<int>(-std::floor(std::log10(step) + 1e-9)));
  std::string text = format("%.*f", digits, std::abs(value) < 1e-6 * step ? 0.0 : value);
  if (text[0] == '-') text.replace(0, 1, "\u2212");
  return text;
}

std::vector<Tick> linear_ticks(double low, double high, int wanted) {
  const double rough = (high - low) / std::max(1, wanted);
  const double decade = std::pow(10.0, std::floor(std::log10(rough)));
  double step = 10.0 * decade;
  for (const double factor : {5.0, 2.0, 1.0}) {
    if (factor * decade >= rough * (1.0 - 1e-9)) step = factor * decade;
  }
  std::vector<Tick> out;
  const double largest = std::max(std::abs(low), std::abs(high));
  for (double i = std::ceil(low / step - 1e-9); i * step <= high + 1e-9 * step; i += 1.0) {
    out.push_back({i * step, linear_text(i * step, step, largest)});
  }
  if (out.size() < 2 && wanted > 1 && wanted < 32) return linear_ticks(low, high, 2 * wanted);  // one alone is no scale
  return out;
}

// 1, 2 and 5 of each decade; only the decades, or each second one and so on, when there are many.
std::vector<Tick> log_ticks(double low, double high, int wanted) {
  const double decades = std::log10(high / low);
  const bool fine = 3.0 * decades <= wanted + 1.0;
  const double stride = std::max(1.0, std::ceil(decades / std::max(1, wanted)));
  std::vector<Tick> out;
  for (double e = std::floor(std::log10(low)); e <= std::log10(high); e += fine ? 1.0 : stride) {
    for (const double factor : {1.0, 2.0, 5.0}) {
      const double value = factor * std::pow(10.0, e);
      if ((fine || factor == 1.0) && value >= low * (1.0 - 1e-9) && value <= high * (1.0 + 1e-9)) {
        out.push_back({value, number_text(value, true)});
      }
    }
  }
  if (out.size() >= 2) return out;
  return linear_ticks(low, high, wanted);  // less than a decade with no round value in it
}

}  // namespace

Scale::Scale(const Axis& axis, const std::vector<double>& values, bool tight)
    : logarithmic_(axis.logarithmic && axis.categories.empty()), categories_(axis.categories) {
  if (!categories_.empty()) {
    low_ = -0.5;
    high_ = static_cast<double>(categories_.size()) - 0.5;
    return;
  }
  double least = kNone;
  double most = kNone;
  for (const double value : values) {
    if (!std::isfinite(value) || (logarithmic_ && value <= 0.0)) continue;
    least = std::isnan(least) ? value : std::min(least, value);
    most = std::isnan(most) ? value : std::max(most, value);
  }
  const bool any = !std::isnan(least);
  if (logarithmic_) {
    const double margin = any && !tight ? std::max(1.15, std::pow(most / least, kMargin)) : 1.0;
    low_ = any ? least / margin : 0.1;
    high_ = any ? most * margin : 10.0;
  } else {
    const double margin = any && !tight ? kMargin * (most - least) : 0.0;
    low_ = any ? least - margin : 0.0;
    high_ = any ? most + margin : 1.0;
    if (any && least >= 0.0 && low_ < 0.0) low_ = 0.0;
  }
  if (std::isfinite(axis.low) && (!logarithmic_ || axis.low > 0.0)) low_ = axis.low;
  if (std::isfinite(axis.high) && (!logarithmic_ || axis.high > 0.0)) high_ = axis.high;
  if (high_ - low_ > 1e-12 * std::max(std::abs(low_), std::abs(high_))) return;
  // One value only: room around it.
  const double around = logarithmic_ ? 0.0 : std::max(1e-6, 0.1 * std::abs(low_));
  high_ = logarithmic_ ? 2.0 * low_ : low_ + around;
  low_ = logarithmic_ ? low_ / 2.0 : low_ - around;
}

double Scale::place(double value) const noexcept {
  if (!logarithmic_) return (value - low_) / (high_ - low_);
  return value > 0.0 ? std::log(value / low_) / std::log(high_ / low_) : kNone;
}

std::vector<Tick> Scale::ticks(int wanted) const {
  if (categories_.empty()) return logarithmic_ ? log_ticks(low_, high_, wanted) : linear_ticks(low_, high_, wanted);
  std::vector<Tick> out;
  for (std::size_t i = 0; i < categories_.size(); ++i) out.push_back({static_cast<double>(i), categories_[i]});
  return out;
}

}  // namespace bolo::plot

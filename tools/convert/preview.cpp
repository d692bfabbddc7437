#include "tools/convert/preview.hpp"

#include <algorithm>
#include <cmath>

#include "src/core/statistics.hpp"

namespace bolo::tools {
namespace {

constexpr double kShare = 0.01;      // of the pixels beyond either end
constexpr double kFollow_s = 0.5;    // time constant
constexpr double kLeastSpan = 1e-6;  // of a scene without contrast

}  // namespace

void Preview::follow(double low, double high) {
  const double weight = begun_ ? 1.0 - std::exp(-format_.frame_period_s / kFollow_s) : 1.0;
  low_ += weight * (low - low_);
  high_ += weight * (high - high_);
  begun_ = true;
}

const std::vector<std::uint8_t>& Preview::levels(const Frame& frame) {
  if (format_.type == PixelType::kUint16) {
    values_.assign(frame.u16.begin(), frame.u16.end());
  } else {
    values_ = frame.f32;
  }
  sample_ = values_;
  std::erase_if(sample_, [](float v) { return !std::isfinite(v); });
  if (!sample_.empty()) {
    const double low = quantile(sample_, kShare);
    follow(low, quantile(sample_, 1.0 - kShare));
  }
  const double gain = 255.0 / std::max(high_ - low_, kLeastSpan);
  levels_.resize(values_.size());
  std::transform(values_.begin(), values_.end(), levels_.begin(), [&](float v) {
    const double level = (v - low_) * gain;
    return level > 0.0 ? static_cast<std::uint8_t>(std::min(level, 255.0)) : std::uint8_t{0};  // not a number: black
  });
  return levels_;
}

}  // namespace bolo::tools

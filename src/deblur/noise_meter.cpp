#include "src/deblur/noise_meter.hpp"

#include <algorithm>
#include <cmath>
#include <numeric>

#include "src/deblur/mmae_kernels.hpp"

namespace bolo::deblur {
namespace {

constexpr int kOrder = 6;
constexpr int kBlockRows = 4;
constexpr int kBlockColumns = 8;
constexpr int kRowStep = 2 * kBlockRows;  // every other row of blocks is used
constexpr double kQuantile = 0.05;
constexpr double kRise = 1.002;       // a frame
constexpr double kFall = 0.2;         // of the way, a frame
constexpr double kMostNoise = 1e7;    // in values; products of variances stay in a float's range
constexpr double kFloatFloor = 1e-3;  // K: of a float capture without noise

// The 5 % quantile of chi^2 with `freedom` degrees over its mean (Wilson and Hilferty, 1931).
double low_quantile(double freedom) {
  constexpr double kNormalQuantile = -1.6449;
  const double v = 2.0 / (9.0 * freedom);
  const double root = 1.0 - v + kNormalQuantile * std::sqrt(v);
  return root * root * root;
}

// Variance of the difference of the given order of white noise: (2n)! / (n!)^2.
double gain(int order) {
  double result = 1.0;
  for (int i = 1; i <= order; ++i) result *= static_cast<double>(order + i) / i;
  return result;
}

}  // namespace

NoiseMeter::NoiseMeter(const StreamTask& task) : task_(task) {
  const bool kelvin = task.input.scale.unit == Unit::kKelvin;
  const double unit = kelvin ? std::abs(task.input.scale.scale) : 1.0;
  floor_ = task.input.type == PixelType::kUint16 ? 1.0 / std::sqrt(12.0) : kFloatFloor / unit;
  given_ = task.settings.noise_k / unit;
  const Geometry g = task.input.geometry;
  column_.resize(static_cast<std::size_t>(g.width) * static_cast<std::size_t>(g.height / kRowStep + 1));
  block_.reserve(column_.size());
}

double NoiseMeter::noise() const noexcept {
  const double noise = given_ > 0.0 ? given_ : std::max(measured_, floor_);
  return std::min(kMostNoise, noise);
}

void NoiseMeter::update(const WindowView& window, const Pattern& pattern, Crew& crew) noexcept {
  if (given_ > 0.0) return;
  int run = 0;  // received frames in a row, newest first
  for (int s = pattern.slots - 1; s >= 0 && run <= kOrder; --s) {
    run = pattern.received[static_cast<std::size_t>(s)] ? run + 1 : 0;
    if (run <= kOrder) continue;
    const double now = measure(&window.planes[static_cast<std::size_t>(s)], kOrder, crew);
    if (now <= 0.0) continue;
    if (measured_ == 0.0) measured_ = now;
    measured_ = now < measured_ ? measured_ + kFall * (now - measured_) : std::min(now, kRise * measured_);
  }
}

// 0 when no block shows any difference: a frozen or synthetic picture.
double NoiseMeter::measure(const void* const* planes, int order, Crew& crew) noexcept {
  const MmaeKernels& kernels = best_mmae_kernels();
  const Geometry g = task_.input.geometry;
  const auto stride = static_cast<std::size_t>(g.width);
  const int rows = std::min(kBlockRows, g.height);
  const int width = std::min(kBlockColumns, g.width);
  std::fill(column_.begin(), column_.end(), 0.0F);
  const int strips = (g.height - rows) / kRowStep + 1;
  for_rows(crew, strips, [&](int strip) {
    const std::size_t first = static_cast<std::size_t>(strip * kRowStep) * stride;
    kernels.add_squared_differences(task_.input.type, planes, order, first, rows, stride, g.width,
                                    column_.data() + static_cast<std::size_t>(strip) * stride);
  });
  block_.clear();
  for (int strip = 0; strip < strips; ++strip) {
    const float* const columns = column_.data() + static_cast<std::size_t>(strip) * stride;
    for (int x = 0; x + width <= g.width; x += width) {
      const float sum = std::accumulate(columns + x, columns + x + width, 0.0F);
      if (sum > 0.0F && std::isfinite(sum)) block_.push_back(sum);  // none at all: dead or saturated
    }
  }
  if (block_.empty()) return 0.0;
  const auto at = block_.begin() + static_cast<std::ptrdiff_t>(kQuantile * static_cast<double>(block_.size()));
  std::nth_element(block_.begin(), at, block_.end());
  const double pixels = rows * width;
  return std::sqrt(static_cast<double>(*at) / pixels / gain(order) / low_quantile(pixels));
}

}  // namespace bolo::deblur

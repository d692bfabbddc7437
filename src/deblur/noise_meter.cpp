#include "src/deblur/noise_meter.hpp"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <numeric>

#include "src/deblur/mmae_kernels.hpp"

namespace bolo::deblur {
namespace {

using Ends = NoiseMeter::Ends;

constexpr int kOrder = 6;
constexpr int kBlockRows = 4;
constexpr int kBlockColumns = 8;
constexpr int kRowStep = 2 * kBlockRows;  // every other row of blocks is used
constexpr double kQuantile = 0.05;
constexpr double kRise = 1.002;       // per frame
constexpr double kFall = 0.2;         // of the way, per frame
constexpr double kMostNoise = 1e7;    // in values; products of variances stay within a float's range
constexpr double kNoNoise = 0.1;      // of the floor: what corrections alone change
constexpr double kFloatFloor = 1e-3;  // K: for a float capture without noise

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

template <typename T>
void widen(const T* row, std::size_t width, Ends& ends) {
  T low = row[0];
  T high = row[0];
  for (std::size_t x = 1; x < width; ++x) {
    low = std::min(low, row[x]);
    high = std::max(high, row[x]);
  }
  ends = {std::min(ends.low, static_cast<float>(low)), std::max(ends.high, static_cast<float>(high))};
}

// Marks blocks that contain an extreme value: an infinite sum leaves its block out.
template <typename T>
void leave_out(const T* row, std::size_t width, const Ends& ends, float* sums) {
  for (std::size_t x = 0; x < width; ++x) {
    const auto value = static_cast<float>(row[x]);
    sums[x] = value > ends.low && value < ends.high ? sums[x] : std::numeric_limits<float>::infinity();
  }
}

}  // namespace

double least_noise(const StreamFormat& input) {
  const double unit = input.scale.unit == Unit::kKelvin ? std::abs(input.scale.scale) : 1.0;
  return input.type == PixelType::kUint16 ? 1.0 / std::sqrt(12.0) : kFloatFloor / unit;
}

NoiseMeter::NoiseMeter(const StreamTask& task)
    : task_(task), floor_(task.noise_floor > 0.0 ? task.noise_floor : least_noise(task.input)) {
  set(task.settings.noise_k);
  const Geometry g = task.input.geometry;
  column_.resize(static_cast<std::size_t>(g.width) * static_cast<std::size_t>(g.height / kRowStep + 1));
  block_.reserve(column_.size());
  ends_.resize(static_cast<std::size_t>(g.height / kRowStep + 1));
}

void NoiseMeter::set(double noise_k) noexcept {
  given_ = noise_k / (task_.input.scale.unit == Unit::kKelvin ? std::abs(task_.input.scale.scale) : 1.0);
}

double NoiseMeter::noise() const noexcept {
  const double noise = given_ > 0.0 ? given_ : std::max(measured_, floor_);
  return std::min(kMostNoise, noise);
}

void NoiseMeter::update(const WindowView& window, const Pattern& pattern, Crew& crew) noexcept {
  int run = 0;  // received frames in a row, newest first
  for (int s = pattern.slots - 1; s >= 0 && run <= kOrder; --s) {
    run = pattern.received[static_cast<std::size_t>(s)] ? run + 1 : 0;
    if (run <= kOrder) continue;
    const double shown = measure(&window.planes[static_cast<std::size_t>(s)], kOrder, crew);
    if (shown <= 0.0) continue;
    const double now = std::max(shown, floor_);  // recovery from a smaller value would take longer
    if (measured_ == 0.0) measured_ = now;
    measured_ = now < measured_ ? measured_ + kFall * (now - measured_) : std::min(now, kRise * measured_);
  }
}

// 0 if no block shows any difference: a frozen or synthetic picture.
double NoiseMeter::measure(const void* const* planes, int order, Crew& crew) noexcept {
  const double calm = calmest(planes, order, true, crew);
  return calm > 0.0 ? calm : calmest(planes, order, false, crew);  // a picture of few values consists of extremes
}

double NoiseMeter::calmest(const void* const* planes, int order, bool without_ends, Crew& crew) noexcept {
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
  if (without_ends) leave_out_ends(planes[0], planes[order], rows, strips, crew);
  const double pixels = rows * width;
  const auto least = static_cast<float>(std::pow(kNoNoise * floor_, 2) * pixels * gain(order));
  block_.clear();
  for (int strip = 0; strip < strips; ++strip) {
    const float* const columns = column_.data() + static_cast<std::size_t>(strip) * stride;
    for (int x = 0; x + width <= g.width; x += width) {
      const float sum = std::accumulate(columns + x, columns + x + width, 0.0F);
      if (sum > least && std::isfinite(sum)) block_.push_back(sum);  // less: dead or saturated
    }
  }
  if (block_.empty()) return 0.0;
  const auto at = block_.begin() + static_cast<std::ptrdiff_t>(kQuantile * static_cast<double>(block_.size()));
  std::nth_element(block_.begin(), at, block_.end());
  return std::sqrt(static_cast<double>(*at) / pixels / gain(order) / low_quantile(pixels));
}

void NoiseMeter::leave_out_ends(const void* oldest, const void* newest, int rows, int strips, Crew& crew) noexcept {
  const auto width = static_cast<std::size_t>(task_.input.geometry.width);
  const auto with_type = [&](auto value) {
    using T = decltype(value);
    const auto for_strips = [&](auto&& work) {
      for_rows(crew, strips, [&](int strip) {
        const auto row = static_cast<std::size_t>(strip);
        for (int r = 0; r < rows; ++r) work(row, (row * kRowStep + static_cast<std::size_t>(r)) * width);
      });
    };
    std::fill(ends_.begin(), ends_.end(), Ends{});
    for_strips(
        [&](std::size_t strip, std::size_t at) { widen(static_cast<const T*>(newest) + at, width, ends_[strip]); });
    Ends all;
    for (const Ends& ends : ends_) all = {std::min(all.low, ends.low), std::max(all.high, ends.high)};
    for_strips([&](std::size_t strip, std::size_t at) {
      for (const void* plane : {oldest, newest}) {
        leave_out(static_cast<const T*>(plane) + at, width, all, column_.data() + strip * width);
      }
    });
  };
  task_.input.type == PixelType::kUint16 ? with_type(std::uint16_t{}) : with_type(float{});
}

}  // namespace bolo::deblur

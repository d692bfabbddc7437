#include "drivers/genicam/scene_watch.hpp"

#include <algorithm>
#include <cstdlib>

#include <fmt/format.h>

#include "src/core/byte_order.hpp"

namespace bolo::genicam {
namespace {

constexpr std::int64_t kComparePeriodNs = 100'000'000;
constexpr std::uint64_t kMedianFrame = 20;  // later than what a camera sends while it begins
constexpr double kLowestK = 200.0;
constexpr double kHighestK = 700.0;

bool plausible(double count, const LinearScale& scale) {
  const double kelvin = scale.to_physical(count);
  return kelvin >= kLowestK && kelvin <= kHighestK;
}

}  // namespace

SceneWatch::SceneWatch(const StreamFormat& format, double still_k) noexcept
    : count_(std::min(format.geometry.pixels(), kMostSamples)),
      step_(format.geometry.pixels() / std::max<std::size_t>(count_, 1)),
      kelvin_per_count_(format.scale.unit == Unit::kKelvin ? format.scale.scale : 1.0),
      still_counts_(still_k / kelvin_per_count_) {}

void SceneWatch::update(const std::uint16_t* plane, std::int64_t now_ns) noexcept {
  const double still_counts = still_counts_.value();
  const bool compares = still_counts > 0.0 && now_ns - compared_ns_ >= kComparePeriodNs;
  const bool first = frames_++ == 0;
  if (!compares && frames_ != kMedianFrame) return;
  Samples now;
  take(plane, now);
  if (compares) {
    const bool still = !first && change(now) <= still_counts;
    if (!still) still_since_ns_.set(0);
    if (still && still_since_ns_.value() == 0) still_since_ns_.set(compared_ns_);
    before_ = now;
    compared_ns_ = now_ns;
  }
  if (frames_ == kMedianFrame) {
    auto* const middle = now.data() + count_ / 2;
    std::nth_element(now.data(), middle, now.data() + count_);
    median_.set(*middle);
  }
}

void SceneWatch::restart() noexcept {
  frames_ = 0;
  still_since_ns_.set(0);
  median_.set(-1);
}

void SceneWatch::take(const std::uint16_t* plane, Samples& samples) const noexcept {
  for (std::size_t i = 0; i < count_; ++i) samples[i] = plane[i * step_];
}

// The mean of the absolute differences.
double SceneWatch::change(const Samples& now) const noexcept {
  std::int64_t sum = 0;
  for (std::size_t i = 0; i < count_; ++i) sum += std::abs(int{now[i]} - int{before_[i]});
  return static_cast<double>(sum) / static_cast<double>(count_);
}

std::optional<std::string> implausible(int median, const LinearScale& scale) {
  if (scale.unit != Unit::kKelvin || plausible(median, scale)) return std::nullopt;
  const int swapped = swap_bytes(static_cast<std::uint16_t>(median));
  std::string advice = "the camera's range or IRFormat is not what was asked for: check source.ir_format";
  if (plausible(swapped, scale)) advice = "with bytes swapped it makes sense: set source.pixel_order to the other one";
  if (plausible(median * 10.0, scale)) advice = "ten times as much makes sense: set source.ir_format = \"100mk\"";
  if (plausible(median * 0.1, scale)) advice = "a tenth makes sense: set source.ir_format = \"10mk\"";
  return fmt::format("half of the picture is above {:.1f} K and half below, which is no temperature of a scene; {}",
                     scale.to_physical(median), advice);
}

}  // namespace bolo::genicam

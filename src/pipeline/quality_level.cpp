#include "src/pipeline/quality_level.hpp"

#include <algorithm>
#include <cmath>

#include "src/core/clock.hpp"

namespace bolo::pipeline {
namespace {

constexpr std::uint64_t kFewWait = 1;  // no backlog: the next frame arrived while this one was solved
constexpr double kShortWait_s = 0.04;  // of waiting frames, for the first level below full; doubled per level

QualityLevel one_up(QualityLevel level) noexcept { return static_cast<QualityLevel>(static_cast<int>(level) - 1); }

}  // namespace

std::string_view name(QualityLevel level) {
  constexpr std::array<std::string_view, kQualityLevels> kNames{"full", "reduced", "inverse", "raw"};
  return kNames[static_cast<std::size_t>(level)];
}

QualityControl::QualityControl(std::uint64_t queue_frames, double period_s) noexcept
    : period_ns_(period_s * kNsPerSecond) {
  calm_for_ns_.fill(kShortestCalmNs);
  for (std::size_t i = 1; i < kQualityLevels; ++i) {
    const double frames = std::round(std::ldexp(kShortWait_s, static_cast<int>(i) - 1) / period_s);
    const auto share = static_cast<double>(queue_frames >> (kQualityLevels - i));
    limits_[i] = std::max(kFewWait + i, static_cast<std::uint64_t>(std::min(share, frames)));
  }
}

QualityLevel QualityControl::least_for(std::uint64_t waiting) const noexcept {
  QualityLevel level = QualityLevel::kFull;
  for (std::size_t i = 1; i < kQualityLevels; ++i) {
    if (waiting >= limits_[i]) level = static_cast<QualityLevel>(i);
  }
  return level;
}

QualityLevel QualityControl::next(std::uint64_t waiting, std::int64_t now_ns) noexcept {
  const QualityLevel needed = least_for(waiting);
  if (needed > level_) {
    const bool too_early = now_ns - stepped_up_ns_ < kTrialNs;
    std::int64_t& calm_ns = calm_for(level_);
    if (!too_early) calm_ns = kShortestCalmNs;
    if (too_early && much_work()) calm_ns = std::min(2 * calm_ns, kLongestCalmNs);
    level_ = needed;
  }
  if (waiting > kFewWait || level_ == QualityLevel::kFull) {
    calm_since_ns_ = now_ns;
  } else if (now_ns - calm_since_ns_ >= calm_for(one_up(level_))) {
    level_ = one_up(level_);
    stepped_up_ns_ = now_ns;
    trial_cpu_ns_ = trial_frames_ = 0;
    calm_since_ns_ = now_ns;
  }
  return level_;
}

}  // namespace bolo::pipeline

#include "src/pipeline/effort.hpp"

#include <algorithm>

namespace bolo::pipeline {
namespace {

constexpr std::uint64_t kFewWait = 1;  // no backlog: the next frame came while this one was solved

Effort one_up(Effort effort) noexcept { return static_cast<Effort>(static_cast<int>(effort) - 1); }

}  // namespace

std::string_view name(Effort effort) {
  constexpr std::array<std::string_view, kEfforts> kNames{"full", "reduced", "inverse", "raw"};
  return kNames[static_cast<std::size_t>(effort)];
}

EffortControl::EffortControl(std::uint64_t queue_frames) noexcept {
  calm_for_ns_.fill(kShortestCalmNs);
  for (std::size_t i = 1; i < kEfforts; ++i) limits_[i] = std::max(kFewWait + i, queue_frames >> (kEfforts - i));
}

Effort EffortControl::least_for(std::uint64_t waiting) const noexcept {
  Effort effort = Effort::kFull;
  for (std::size_t i = 1; i < kEfforts; ++i) {
    if (waiting >= limits_[i]) effort = static_cast<Effort>(i);
  }
  return effort;
}

Effort EffortControl::next(std::uint64_t waiting, std::int64_t now_ns) noexcept {
  const Effort needed = least_for(waiting);
  if (needed > effort_) {
    const bool too_early = now_ns - stepped_up_ns_ < kTrialNs;
    std::int64_t& calm_ns = calm_for(effort_);
    calm_ns = too_early ? std::min(2 * calm_ns, kLongestCalmNs) : kShortestCalmNs;
    effort_ = needed;
  }
  if (waiting > kFewWait || effort_ == Effort::kFull) {
    calm_since_ns_ = now_ns;
  } else if (now_ns - calm_since_ns_ >= calm_for(one_up(effort_))) {
    effort_ = one_up(effort_);
    stepped_up_ns_ = now_ns;
    calm_since_ns_ = now_ns;
  }
  return effort_;
}

}  // namespace bolo::pipeline

// Levels of effort for each frame: when deblurring can't keep up, cheaper methods in a fixed order rather than lost
// frames.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <string_view>

namespace bolo::pipeline {

enum class QualityLevel : std::uint8_t {
  kFull,     // as the settings say
  kReduced,  // mmae in place of motion and of an automatic lambda; else one sweep of coordinate descent on the dual
  kInverse,  // the inverse filter, on the pipeline thread alone: it waits for no worker
  kRaw,      // the deblurred plane is the raw one
};
inline constexpr std::size_t kQualityLevels = 4;

// "full", "reduced", "inverse", "raw". Thread: any.
std::string_view name(QualityLevel level);

// Its flag in a frame's meta (FrameFlag, shm_layout.h); 0 for kFull. Thread: any.
constexpr std::uint32_t flag_of(QualityLevel level) noexcept {
  return level == QualityLevel::kFull ? 0U : 16U << static_cast<unsigned>(level);
}

// Decides before each frame, from how many wait behind it.
//
// Down the list: as soon as a share of the queue is filled, 1/8, 1/4 and 1/2 for the three, or with the frames of 40,
// 80 and 160 ms where those are fewer (but at least two, three and four): a slow camera's queue would hold seconds, and
// frames that old are of little use. At a half 32 frames are left of the default 64 before anything is lost.
// Up: one step at a time, when nothing has waited for a while. When a step turns out to be too much within kTrialNs, it
// is tried again after twice the time, up to kLongestCalmNs: on a machine that is too slow for good, quality does not
// swing with every frame. That is not said of a step whose frames took little processor time (kLittleWork): other
// programs kept the thread from running, which a cheaper method does not change.
//
// Thread: one at a time.
class QualityControl {
 public:
  static constexpr std::int64_t kShortestCalmNs = 50'000'000;
  static constexpr std::int64_t kLongestCalmNs = 30'000'000'000;
  static constexpr std::int64_t kTrialNs = 2'000'000'000;

  QualityControl(std::uint64_t queue_frames, double period_s) noexcept;

  // Of each frame with a full window after its next(): processor time of the pipeline thread.
  void spent(std::int64_t cpu_ns) noexcept {
    trial_cpu_ns_ += cpu_ns;
    ++trial_frames_;
  }

  // `waiting`: frames in the queue behind this one. `now_ns`: CLOCK_MONOTONIC.
  QualityLevel next(std::uint64_t waiting, std::int64_t now_ns) noexcept;

 private:
  static constexpr double kLittleWork = 0.5;  // periods: a thread that runs half of the time manages it

  bool much_work() const noexcept {
    return static_cast<double>(trial_cpu_ns_) > kLittleWork * period_ns_ * static_cast<double>(trial_frames_);
  }
  std::int64_t& calm_for(QualityLevel level) noexcept { return calm_for_ns_[static_cast<std::size_t>(level)]; }
  QualityLevel least_for(std::uint64_t waiting) const noexcept;

  std::array<std::uint64_t, kQualityLevels> limits_{};  // frames that wait, from which on a level is not exceeded
  QualityLevel level_ = QualityLevel::kFull;
  std::int64_t calm_since_ns_ = 0;
  std::array<std::int64_t, kQualityLevels> calm_for_ns_{};  // that the step up to each needs
  std::int64_t stepped_up_ns_ = -kTrialNs;
  double period_ns_;
  std::int64_t trial_cpu_ns_ = 0;  // of frames since then
  std::int64_t trial_frames_ = 0;
};

}  // namespace bolo::pipeline

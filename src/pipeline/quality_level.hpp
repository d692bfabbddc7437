// Levels of effort per frame: if deblurring can't keep up, cheaper methods in a fixed order instead of lost frames.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <string_view>

namespace bolo::pipeline {

enum class QualityLevel : std::uint8_t {
  kFull,     // as the settings say
  kReduced,  // mmae in place of motion and of automatic lambda; otherwise one sweep of coordinate descent on the dual
  kInverse,  // the inverse filter, on the pipeline thread alone: no dependence on workers
  kRaw,      // the deblurred plane is the raw one
};
inline constexpr std::size_t kQualityLevels = 4;

// "full", "reduced", "inverse", "raw". Thread: any.
std::string_view name(QualityLevel level);

// The level's flag in a frame's meta (FrameFlag, shm_layout.h); 0 for kFull. Thread: any.
constexpr std::uint32_t flag_of(QualityLevel level) noexcept {
  return level == QualityLevel::kFull ? 0U : 16U << static_cast<unsigned>(level);
}

// Chooses the level of each frame from the number of frames that wait behind it.
//
// Down: as soon as a share of the queue is filled, 1/8, 1/4 and 1/2 for the three levels, or by the frames of 40, 80
// and 160 ms if those are fewer (but at least two, three and four): a slow camera's queue would hold seconds, and
// frames that old are of little use. At 1/2, 32 of the default 64 frames are left before anything is lost.
// Up: one level at a time, when nothing has waited for a while. If a step up proves too much within kTrialNs, it is
// tried again after twice the time, up to kLongestCalmNs: on a machine that is always too slow, quality does not
// oscillate. That does not apply if the level's frames took little processor time (kLittleWork): other programs kept
// the thread from running, which a cheaper method does not change.
//
// Thread: one at a time.
class QualityControl {
 public:
  static constexpr std::int64_t kShortestCalmNs = 50'000'000;
  static constexpr std::int64_t kLongestCalmNs = 30'000'000'000;
  static constexpr std::int64_t kTrialNs = 2'000'000'000;

  QualityControl(std::uint64_t queue_frames, double period_s) noexcept;

  // Called after next() for each frame with a full window: processor time of the pipeline thread.
  void spent(std::int64_t cpu_ns) noexcept {
    trial_cpu_ns_ += cpu_ns;
    ++trial_frames_;
  }

  // `waiting`: frames in the queue behind this one. `now_ns`: CLOCK_MONOTONIC.
  QualityLevel next(std::uint64_t waiting, std::int64_t now_ns) noexcept;

 private:
  static constexpr double kLittleWork = 0.5;  // periods: a thread that runs half of the time keeps up

  bool much_work() const noexcept {
    return static_cast<double>(trial_cpu_ns_) > kLittleWork * period_ns_ * static_cast<double>(trial_frames_);
  }
  std::int64_t& calm_for(QualityLevel level) noexcept { return calm_for_ns_[static_cast<std::size_t>(level)]; }
  QualityLevel least_for(std::uint64_t waiting) const noexcept;

  std::array<std::uint64_t, kQualityLevels> limits_{};  // waiting frames, from which on a level is not exceeded
  QualityLevel level_ = QualityLevel::kFull;
  std::int64_t calm_since_ns_ = 0;
  std::array<std::int64_t, kQualityLevels> calm_for_ns_{};  // calm time required for the step up to each level
  std::int64_t stepped_up_ns_ = -kTrialNs;
  double period_ns_;
  std::int64_t trial_cpu_ns_ = 0;  // of frames since the last step up
  std::int64_t trial_frames_ = 0;
};

}  // namespace bolo::pipeline

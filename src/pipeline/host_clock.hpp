// Maps the camera's clock to the host's: the time of a frame on CLOCK_MONOTONIC.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <span>

#include "src/core/clock.hpp"

namespace bolo::pipeline {

// A frame arrives late by the transport delay: at least its minimum, more when something was busy. Arrival minus camera
// time, over camera time, therefore lies above a line whose slope is the drift between the clocks. The line used is the
// edge of the points' lower convex hull at their mean time: of all lines below the points the closest to them (Moon,
// Skelly, Towsley, "Estimation and removal of clock skew from network delay measurements", INFOCOM 1999). The points
// are the fastest frames of each half second of the last ten. The remaining error is the minimum delay, which looks
// like an offset of the clocks. Thread: acquire, or setup while no connection delivers. No allocation.
class HostClock {
 public:
  // period_s: the frame period, to distinguish a jump of the clock from lost frames.
  explicit HostClock(double period_s) noexcept;

  struct Mapped {
    std::int64_t host_ns = 0;  // never later than the arrival
    bool jumped = false;  // the camera's clock jumped since the last frame: by more than frame counter and host's clock
                          // allow, and by at least 20 ms and four periods
  };
  // receive_ns: CLOCK_MONOTONIC of the arrival. Frame ids rise.
  Mapped map(std::uint64_t frame_id, std::int64_t camera_ns, std::int64_t receive_ns) noexcept;

  // Frames of another connection follow: the clock may have been reset.
  void restart() noexcept { started_ = false; }

  // Host's clock - camera's, at the last frame.
  std::int64_t offset_ns() const noexcept { return base_ns_ + static_cast<std::int64_t>(line_at(last_camera_ns_)); }
  // Drift, parts per million, positive if the camera's clock is slower; 0 within the first two seconds.
  double drift_ppm() const noexcept { return slope_ * 1e6; }
  // Root mean square of arrivals above the line in the last complete half second, ns.
  double jitter_ns() const noexcept { return jitter_ns_; }

 private:
  struct Point {
    double camera_ns = 0.0;  // since begin_ns_
    double late_ns = 0.0;    // arrival - camera time - base_ns_
  };
  static constexpr std::size_t kPoints = 20;

  void begin(std::int64_t camera_ns, std::int64_t receive_ns) noexcept;
  bool has_jumped(std::uint64_t frame_id, std::int64_t camera_ns, std::int64_t receive_ns) const noexcept;
  void collect(const Point& point) noexcept;
  void close_bucket() noexcept;
  void fit() noexcept;
  double line_at(std::int64_t camera_ns) const noexcept {
    return level_ns_ + slope_ * static_cast<double>(camera_ns - begin_ns_);
  }

  const double period_ns_;
  bool started_ = false;
  std::int64_t begin_ns_ = 0;  // camera's clock
  std::int64_t base_ns_ = 0;   // arrival - camera time of the first frame
  std::uint64_t last_id_ = 0;
  std::int64_t last_camera_ns_ = 0;
  std::int64_t last_receive_ns_ = 0;
  double level_ns_ = 0.0;  // the line
  double slope_ = 0.0;
  double jitter_ns_ = 0.0;

  Point fastest_;  // of the current half second
  double bucket_end_ns_ = 0.0;
  double sum_squares_ = 0.0;
  std::size_t frames_ = 0;

  std::array<Point, kPoints> points_{};  // a ring, in time order from first_ on
  std::size_t first_ = 0;
  std::size_t count_ = 0;
};

// The step from one frame to the next when stamps jitter or count in coarse ticks: mean of the steps that differ from
// their median by less than 0.6 of it (half a step is the tick of a camera that is read one and a half times as often
// as it takes pictures), so that pauses and lost frames do not affect it. 0 without steps.
struct UsualStep {
  double mean = 0.0;
  double error = 0.0;  // standard error of the mean; a stamp's error is in two steps, and cancels
};

// Reorders the steps. No allocation.
UsualStep usual_step(std::span<double> steps) noexcept;

// Relative: the deblurring cannot tell periods that differ by less.
inline constexpr double kSamePeriod = 0.005;

// Measures the frame period by the camera's own clock, independently of its settings: the usual one of 32 clock steps,
// each divided by the counter's; averaged over several such runs if stamps jitter. Thread: acquire. No allocation.
class PeriodMeter {
 public:
  // Frames of another connection follow, or the clock jumped.
  void restart() noexcept {
    started_ = false;
    means_ = errors_ = runs_ = 0.0;
  }

  // Period, s; 0 unless this frame completed a measurement.
  double add(std::uint64_t frame_id, std::int64_t camera_ns) noexcept {
    const bool follows = started_ && frame_id > last_id_ && camera_ns > last_ns_;
    if (follows) {
      steps_ns_[count_++] = static_cast<double>(camera_ns - last_ns_) / static_cast<double>(frame_id - last_id_);
    } else {
      count_ = 0;
    }
    started_ = true;
    last_id_ = frame_id;
    last_ns_ = camera_ns;
    if (count_ < steps_ns_.size()) return 0.0;
    count_ = 0;
    return add_run(usual_step(steps_ns_));
  }

 private:
  double add_run(const UsualStep& step) noexcept {
    constexpr double kMostRuns = 64;  // the period of a clock that jitters more stays unknown
    constexpr double kSure = 3.0;     // standard errors
    means_ += step.mean;
    errors_ += step.error * step.error;
    runs_ += 1.0;
    const bool sure = kSure * std::sqrt(errors_) <= kSamePeriod * means_;
    if (!sure && runs_ < kMostRuns) return 0.0;
    const double mean_s = means_ / runs_ / kNsPerSecond;
    means_ = errors_ = runs_ = 0.0;
    return sure ? mean_s : 0.0;
  }

  std::array<double, 32> steps_ns_{};
  std::size_t count_ = 0;
  bool started_ = false;
  std::uint64_t last_id_ = 0;
  std::int64_t last_ns_ = 0;
  // Over runs: sums of the means and of the squared errors.
  double means_ = 0.0;
  double errors_ = 0.0;
  double runs_ = 0.0;
};

// Reports each change of the frame period, measured by the camera's clock, once. If the period keeps changing, ever
// fewer changes are reported, until it has been steady for as long as the pause between reports.
class PeriodChange {
 public:
  // Returns the previous period, s, if the measured one differs from it, otherwise 0. `measured_s`: 0 while unknown.
  double update(double measured_s, double stated_s, std::int64_t now_ns) noexcept {
    constexpr std::int64_t kFirstPauseNs = 1'000'000'000;
    constexpr std::int64_t kLongestPauseNs = 60 * kFirstPauseNs;
    const double known_s = known_s_ > 0.0 ? known_s_ : stated_s;
    if (measured_s <= 0.0 || std::abs(measured_s / known_s - 1.0) < kSamePeriod || now_ns < next_ns_) return 0.0;
    const bool steady = now_ns - next_ns_ > pause_ns_;
    pause_ns_ = steady ? kFirstPauseNs : std::min(2 * pause_ns_, kLongestPauseNs);
    next_ns_ = now_ns + pause_ns_;
    known_s_ = measured_s;
    return known_s;
  }

 private:
  double known_s_ = 0.0;  // 0: as stated
  std::int64_t pause_ns_ = 0;
  std::int64_t next_ns_ = 0;  // CLOCK_MONOTONIC
};

}  // namespace bolo::pipeline

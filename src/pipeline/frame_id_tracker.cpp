#include "src/pipeline/frame_id_tracker.hpp"

#include <algorithm>
#include <bit>
#include <utility>

#include "src/core/clock.hpp"

namespace bolo::pipeline {
namespace {

constexpr std::uint64_t kLargest16 = 0xFFFF;
constexpr std::uint32_t kWindowMask = (1U << FrameIdTracker::kReorderFrames) - 1;

// Aravis itself drops frames up to 100 behind the newest; frames further back mean that the counter was reset.
constexpr std::int64_t kResetBehind = 64;
// A jump ahead of up to this many frames is accepted without checking the clock.
constexpr double kTrustedFrames = 200;
// Beyond that, at most as many frames can be lost as fit into the elapsed time, with this margin.
constexpr double kTimeMargin = 2.0;

}  // namespace

FrameIdTracker::FrameIdTracker(double period_s) noexcept : period_ns_(period_s * kNsPerSecond) {}

FrameIdTracker::Verdict FrameIdTracker::complete(std::uint64_t raw_id, std::int64_t arrival_ns) noexcept {
  if (place(raw_id, arrival_ns) != Place::kNew) {
    count(LossCause::kOutOfOrder);
    return {};
  }
  return {highest_, true, std::exchange(counter_reset_, false)};
}

void FrameIdTracker::broken(std::uint64_t raw_id, LossCause cause, std::int64_t arrival_ns) noexcept {
  if (place(raw_id, arrival_ns) != Place::kDuplicate) count(cause);
}

void FrameIdTracker::broken_without_id() noexcept { ++unplaced_; }

// The first frames without an id are these; the others were not the camera's.
void FrameIdTracker::place_broken(std::uint64_t frames) noexcept {
  count(LossCause::kIncomplete, frames);
  unplaced_ = 0;
}

void FrameIdTracker::finish() noexcept {
  place_broken(unplaced_);
  close_window();
}

FrameIdTracker::Place FrameIdTracker::place(std::uint64_t raw_id, std::int64_t arrival_ns) noexcept {
  zero_seen_ = zero_seen_ || raw_id == 0;
  if (!started_) {
    start(raw_id, arrival_ns);
    return Place::kNew;
  }
  const std::int64_t steps = steps_from_highest(raw_id);
  if (reset_next_ || is_reset(steps, arrival_ns)) {
    reset_counter();
  } else if (steps <= 0) {
    const auto behind = static_cast<unsigned>(-steps);
    const std::uint32_t bit = behind < kReorderFrames ? 1U << behind : 0U;
    if (bit == 0U || (known_ & bit) != 0U) return Place::kDuplicate;
    known_ |= bit;
    return Place::kLate;
  } else {
    advance(static_cast<std::uint64_t>(steps));
  }
  highest_raw_ = raw_id;
  highest_ns_ = arrival_ns;
  return Place::kNew;
}

void FrameIdTracker::start(std::uint64_t raw_id, std::int64_t arrival_ns) noexcept {
  started_ = true;
  reset_next_ = false;
  highest_ = highest_raw_ = raw_id;
  highest_ns_ = arrival_ns;
  place_broken(std::min(unplaced_, raw_id));
}

void FrameIdTracker::reset_counter() noexcept {
  close_window();
  highest_ += unplaced_ + 1;
  place_broken(unplaced_);
  reset_next_ = false;
  counter_reset_ = true;
}

// The newest frame is now `frames` further on; those in between are open, except those known to be broken.
void FrameIdTracker::advance(std::uint64_t frames) noexcept {
  const std::uint64_t gap = frames - 1;
  const std::uint64_t broken_in_gap = std::min(unplaced_, gap);
  place_broken(broken_in_gap);
  highest_ += frames;
  if (frames >= kReorderFrames) {
    const auto open_before = static_cast<std::uint64_t>(std::popcount(~known_ & kWindowMask));
    const std::uint64_t open_in_window = std::min<std::uint64_t>(gap - broken_in_gap, kReorderFrames - 1);
    count(LossCause::kMissing, open_before + (gap - broken_in_gap - open_in_window));
    known_ = ~0U << (open_in_window + 1) | 1U;
    return;
  }
  const std::uint32_t leaving = kWindowMask & ~(kWindowMask >> frames);
  count(LossCause::kMissing, static_cast<std::uint64_t>(std::popcount(~known_ & leaving)));
  const std::uint32_t open = ((1U << gap) - 1) & ~((1U << broken_in_gap) - 1);
  known_ = known_ << frames | (((1U << frames) - 1) & ~(open << 1));
}

// Frames that are still open will not arrive any more.
void FrameIdTracker::close_window() noexcept {
  count(LossCause::kMissing, static_cast<std::uint64_t>(std::popcount(~known_ & kWindowMask)));
  known_ = ~0U;
}

std::int64_t FrameIdTracker::steps_from_highest(std::uint64_t raw_id) const noexcept {
  const auto difference = static_cast<std::int64_t>(raw_id - highest_raw_);
  if (raw_id > kLargest16 || highest_raw_ > kLargest16) return difference;
  const std::int64_t period = zero_seen_ ? 65536 : 65535;
  const std::int64_t ahead = ((difference % period) + period) % period;
  return ahead <= period / 2 ? ahead : ahead - period;
}

bool FrameIdTracker::is_reset(std::int64_t steps, std::int64_t arrival_ns) const noexcept {
  if (steps <= -kResetBehind) return true;
  const double elapsed_frames = static_cast<double>(arrival_ns - highest_ns_) / period_ns_;
  return static_cast<double>(steps) > kTrustedFrames + kTimeMargin * elapsed_frames;
}

Arrivals::Arrivals(FrameInlet& inlet, SourceStatus& status) noexcept
    : ids(inlet.format().frame_period_s), inlet_(inlet), status_(status), clock_(inlet.format().frame_period_s) {}

void Arrivals::restart() noexcept {
  ids.restart();
  clock_.restart();
  period_.restart();
}

std::int64_t Arrivals::map_time(const FrameIdTracker::Verdict& verdict, std::int64_t camera_ns,
                                std::int64_t receive_ns) noexcept {
  if (verdict.counter_reset) {
    clock_.restart();
    period_.restart();
    inlet_.restart_window();
  }
  const HostClock::Mapped mapped = clock_.map(verdict.frame_id, camera_ns, receive_ns);
  if (mapped.jumped) {
    status_.clock_jumps.add();
    period_.restart();
    inlet_.restart_window();
  }
  if (const double period_s = period_.add(verdict.frame_id, camera_ns); period_s > 0.0) {
    status_.measured_period_s.set(period_s);
  }
  status_.clock_offset_ns.set(clock_.offset_ns());
  status_.clock_drift_ppm.set(clock_.drift_ppm());
  status_.clock_jitter_ns.set(clock_.jitter_ns());
  return mapped.host_ns;
}

void Arrivals::post_losses() noexcept {
  for (std::size_t i = 0; i < kLossCauses; ++i) {
    const auto cause = static_cast<LossCause>(i);
    const std::uint64_t counted = ids.counted(cause);
    if (counted != posted_[i]) inlet_.count_loss(cause, counted - posted_[i]);
    posted_[i] = counted;
  }
}

void Arrivals::finish() noexcept {
  ids.finish();
  post_losses();
}

}  // namespace bolo::pipeline

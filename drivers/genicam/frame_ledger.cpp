#include "drivers/genicam/frame_ledger.hpp"

#include <algorithm>
#include <bit>

#include "src/core/clock.hpp"

namespace bolo::genicam {
namespace {

constexpr std::uint64_t kLargest16 = 0xFFFF;
constexpr std::uint32_t kWindowMask = (1U << FrameLedger::kReorderFrames) - 1;

// Aravis itself drops frames up to 100 behind the newest; what is further back is a counter that began again.
constexpr std::int64_t kResetBehind = 64;
// A jump ahead of up to this many frames is believed without looking at the clock.
constexpr double kBelievedFrames = 200;
// Beyond that, no more frames can be lost than fit into the time that has passed, with this margin.
constexpr double kTimeMargin = 2.0;

}  // namespace

FrameLedger::FrameLedger(double period_s) noexcept : period_ns_(period_s * kNsPerSecond) {}

std::uint64_t FrameLedger::lost() const noexcept {
  std::uint64_t sum = 0;
  for (const std::uint64_t n : counted_) sum += n;
  return sum - duplicates_;
}

FrameLedger::Verdict FrameLedger::complete(std::uint64_t raw_id, std::int64_t arrival_ns) noexcept {
  switch (place(raw_id, arrival_ns)) {
    case Place::kNew:
      ++received_;
      break;
    case Place::kLate:
      count(LossCause::kOutOfOrder);
      return {};
    case Place::kDuplicate:
      count(LossCause::kOutOfOrder);
      ++duplicates_;
      return {};
  }
  const bool restarted = restarted_;
  restarted_ = false;
  return {highest_, true, restarted};
}

void FrameLedger::broken(std::uint64_t raw_id, LossCause cause, std::int64_t arrival_ns) noexcept {
  if (place(raw_id, arrival_ns) != Place::kDuplicate) count(cause);
}

void FrameLedger::broken_without_id() noexcept { ++unplaced_; }

// The first of those without an id are these frames; the rest were none of the camera's.
void FrameLedger::place_broken(std::uint64_t frames) noexcept {
  count(LossCause::kIncomplete, frames);
  unplaced_ = 0;
}

void FrameLedger::settle() noexcept {
  if (!started_ && unplaced_ > 0) {
    started_ = true;
    lowest_ = 1;  // highest_ is 0: the frames without id are all there is
  }
  highest_ += unplaced_;
  place_broken(unplaced_);
  close_window();
}

FrameLedger::Place FrameLedger::place(std::uint64_t raw_id, std::int64_t arrival_ns) noexcept {
  zero_seen_ = zero_seen_ || raw_id == 0;
  if (!started_) {
    start(raw_id, arrival_ns);
    return Place::kNew;
  }
  const std::int64_t steps = steps_from_highest(raw_id);
  if (restart_next_ || is_reset(steps, arrival_ns)) {
    reset_counter();
  } else if (steps <= 0) {
    const auto behind = static_cast<unsigned>(-steps);
    const std::uint32_t bit = behind < kReorderFrames ? 1U << behind : 0U;
    if (bit == 0U || (settled_ & bit) != 0U) return Place::kDuplicate;
    settled_ |= bit;
    return Place::kLate;
  } else {
    advance(static_cast<std::uint64_t>(steps));
  }
  highest_raw_ = raw_id;
  highest_ns_ = arrival_ns;
  return Place::kNew;
}

void FrameLedger::start(std::uint64_t raw_id, std::int64_t arrival_ns) noexcept {
  started_ = true;
  restart_next_ = false;
  highest_ = highest_raw_ = raw_id;
  highest_ns_ = arrival_ns;
  lowest_ = raw_id - std::min(unplaced_, raw_id);
  place_broken(raw_id - lowest_);
}

void FrameLedger::reset_counter() noexcept {
  close_window();
  highest_ += unplaced_ + 1;
  place_broken(unplaced_);
  restart_next_ = false;
  restarted_ = true;
  ++restarts_;
}

// The newest frame is now `frames` further on; those between are open, but for the ones known to be broken.
void FrameLedger::advance(std::uint64_t frames) noexcept {
  const std::uint64_t gap = frames - 1;
  const std::uint64_t broken_in_gap = std::min(unplaced_, gap);
  place_broken(broken_in_gap);
  highest_ += frames;
  if (frames >= kReorderFrames) {
    const auto open_before = static_cast<std::uint64_t>(std::popcount(~settled_ & kWindowMask));
    const std::uint64_t open_in_window = std::min<std::uint64_t>(gap - broken_in_gap, kReorderFrames - 1);
    count(LossCause::kMissing, open_before + (gap - broken_in_gap - open_in_window));
    settled_ = ~0U << (open_in_window + 1) | 1U;
    return;
  }
  const std::uint32_t leaving = kWindowMask & ~(kWindowMask >> frames);
  count(LossCause::kMissing, static_cast<std::uint64_t>(std::popcount(~settled_ & leaving)));
  const std::uint32_t open = ((1U << gap) - 1) & ~((1U << broken_in_gap) - 1);
  settled_ = settled_ << frames | (((1U << frames) - 1) & ~(open << 1));
}

// Whatever is still open will not come any more.
void FrameLedger::close_window() noexcept {
  count(LossCause::kMissing, static_cast<std::uint64_t>(std::popcount(~settled_ & kWindowMask)));
  settled_ = ~0U;
}

std::int64_t FrameLedger::steps_from_highest(std::uint64_t raw_id) const noexcept {
  const auto difference = static_cast<std::int64_t>(raw_id - highest_raw_);
  if (raw_id > kLargest16 || highest_raw_ > kLargest16) return difference;
  const std::int64_t period = zero_seen_ ? 65536 : 65535;
  const std::int64_t ahead = ((difference % period) + period) % period;
  return ahead <= period / 2 ? ahead : ahead - period;
}

bool FrameLedger::is_reset(std::int64_t steps, std::int64_t arrival_ns) const noexcept {
  if (steps <= -kResetBehind) return true;
  const double elapsed_frames = static_cast<double>(arrival_ns - highest_ns_) / period_ns_;
  return static_cast<double>(steps) > kBelievedFrames + kTimeMargin * elapsed_frames;
}

}  // namespace bolo::genicam

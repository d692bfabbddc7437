#include "drivers/shm/followed_stream.hpp"

#include <algorithm>
#include <chrono>
#include <limits>
#include <thread>
#include <utility>

#include "src/core/clock.hpp"

namespace bolo::shm {
namespace {

constexpr int kRetry_ms = 10;         // for a missing writer
constexpr int kMostSilence_ms = 100;  // the writer may be dead: check its name
constexpr int kAttempts = 3;          // to catch a frame of a ring that is overwritten continuously

class Deadline {
 public:
  explicit Deadline(int timeout_ms)
      : ns_(timeout_ms < 0 ? std::numeric_limits<std::int64_t>::max()
                           : monotonic_ns() + std::int64_t{timeout_ms} * 1'000'000) {}

  bool passed() const noexcept { return monotonic_ns() >= ns_; }
  // Remaining time, rounded up and clamped to `most`.
  int left_ms(int most) const noexcept {
    const std::int64_t left_ns = ns_ - monotonic_ns();
    return static_cast<int>(std::clamp<std::int64_t>((left_ns - 1) / 1'000'000 + 1, 0, most));
  }
  void pause() const { std::this_thread::sleep_for(std::chrono::milliseconds(left_ms(kRetry_ms))); }

 private:
  std::int64_t ns_;
};

// The object may become readable soon: its writer may be starting.
bool is_transient(Refusal refusal) {
  return refusal == Refusal::kAbsent || refusal == Refusal::kNotReady || refusal == Refusal::kDenied ||
         refusal == Refusal::kForeign;
}

}  // namespace

FollowedStream::FollowedStream(ShmReader reader) : reader_(std::move(reader)) {
  begin();
  next_ = reader_.published();
  if (next_ > 0) --next_;
}

// A writer's silence must be detected before its successor's ring wraps around, at any frame rate.
void FollowedStream::begin() {
  const bolo_shm_header header = reader_.header();
  slot_count_ = header.slot_count;
  const double quarter_ms = 250.0 * static_cast<double>(slot_count_) * header.frame_period_s;
  silence_ms_ = static_cast<int>(std::clamp<double>(quarter_ms, 1, kMostSilence_ms));
}

Result<FollowedStream> FollowedStream::open(const std::string& name, int timeout_ms, Refusal* refusal) {
  const Deadline deadline(timeout_ms);
  while (true) {
    Refusal why = Refusal::kNone;
    Result<ShmReader> reader = ShmReader::open(name, &why);
    if (refusal != nullptr) *refusal = why;
    if (reader) return FollowedStream(std::move(*reader));
    if (!is_transient(why) || deadline.passed()) return tl::unexpected<Error>(reader.error());
    deadline.pause();
  }
}

FollowedStream::Outcome FollowedStream::next(BorrowedFrame& frame, std::uint64_t& missed, int timeout_ms) {
  return give(Order::kNext, frame, missed, timeout_ms);
}

FollowedStream::Outcome FollowedStream::latest(BorrowedFrame& frame, std::uint64_t& missed, int timeout_ms) {
  return give(Order::kLatest, frame, missed, timeout_ms);
}

FollowedStream::Outcome FollowedStream::give(Order order, BorrowedFrame& frame, std::uint64_t& missed, int timeout_ms) {
  const Deadline deadline(timeout_ms);
  while (true) {
    const ShmReader::Outcome found = reader_.wait(next_, deadline.left_ms(silence_ms_));
    const bool there = found == ShmReader::Outcome::kFrame || found == ShmReader::Outcome::kOverwritten;
    if (there && take(order, frame, missed)) return Outcome::kFrame;
    if (follow()) return Outcome::kRestarted;
    if (deadline.passed()) return found == ShmReader::Outcome::kClosed ? Outcome::kEnded : Outcome::kTimeout;
    if (found != ShmReader::Outcome::kTimeout) deadline.pause();
  }
}

// At the ring's tail the writer would overtake the reader again, so a late reader continues in the middle.
bool FollowedStream::take(Order order, BorrowedFrame& frame, std::uint64_t& missed) {
  for (int attempt = 0; attempt < kAttempts; ++attempt) {
    const std::uint64_t published = reader_.published();
    std::uint64_t number = next_;
    if (order == Order::kLatest) {
      number = std::max(number, published - 1);
    } else if (attempt > 0 || published - number > slot_count_) {
      number = std::max(number, published - std::min(published, slot_count_ / 2 + 1));
    }
    if (const auto lent = reader_.borrow(number)) {
      frame = *lent;
      missed = number - next_;
      next_ = number + 1;
      return true;
    }
  }
  return false;
}

bool FollowedStream::follow() {
  obstacle_.clear();
  if (!reader_.replaced()) {
    if (reader_.closed()) obstacle_ = "shared memory '" + reader_.name() + "': its writer has ended or stands still";
    return false;
  }
  Result<ShmReader> successor = ShmReader::open(reader_.name());
  if (!successor) {
    obstacle_ = successor.error().message;
    return false;
  }
  reader_ = std::move(*successor);
  begin();
  next_ = 0;
  ++restarts_;
  return true;
}

}  // namespace bolo::shm

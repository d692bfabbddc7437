// The frames published under a name, across restarts of the writer.
#pragma once

#include <cstdint>
#include <string>

#include "drivers/shm/shm_reader.hpp"
#include "src/core/result.hpp"

namespace bolo::shm {

class FollowedStream {
 public:
  // Starts at the newest frame, or at the first to be published. Waits for a stream that does not exist or is not
  // readable yet; timeout_ms < 0: without limit. Thread: setup.
  static Result<FollowedStream> open(const std::string& name, int timeout_ms, Refusal* refusal = nullptr);

  enum class Outcome {
    kFrame,
    kTimeout,  // the writer lives, but published nothing in time
    kEnded,    // the writer ended or stopped without a successor in time; obstacle() describes the name's present owner
    kRestarted,  // new writer: reader() is of its object and counts from 0; frames of the old one are gone unless held
  };
  // The next frame in order or, if it was overwritten, one from the middle of the ring. `missed`: frames skipped since
  // the last one returned. timeout_ms < 0: without limit. Thread: one at a time.
  Outcome next(BorrowedFrame& frame, std::uint64_t& missed, int timeout_ms);
  // The newest frame not returned yet. Thread: one at a time.
  Outcome latest(BorrowedFrame& frame, std::uint64_t& missed, int timeout_ms);

  // Switches to a new writer of the name; unread frames of the old one are dropped. next() and latest() call it only
  // when no frame is left, so that none is lost. False: no new writer, or not readable yet. Thread: one at a time.
  bool follow();

  const ShmReader& reader() const noexcept { return reader_; }
  // Number of restarts followed.
  std::uint64_t restarts() const noexcept { return restarts_; }
  const std::string& obstacle() const noexcept { return obstacle_; }

 private:
  enum class Order { kNext, kLatest };
  explicit FollowedStream(ShmReader reader);
  Outcome give(Order order, BorrowedFrame& frame, std::uint64_t& missed, int timeout_ms);
  bool take(Order order, BorrowedFrame& frame, std::uint64_t& missed);
  void begin();

  ShmReader reader_;
  std::uint64_t next_ = 0;  // publication number
  std::uint64_t slot_count_ = 1;
  int silence_ms_ = 1;
  std::uint64_t restarts_ = 0;
  std::string obstacle_;
};

}  // namespace bolo::shm

// The frames of a name, across the writers that come and go under it.
#pragma once

#include <cstdint>
#include <string>

#include "drivers/shm/shm_reader.hpp"
#include "src/core/result.hpp"

namespace bolo::shm {

class FollowedStream {
 public:
  // Begins with the newest frame, or the first one to come. A stream that is not there yet, or not yet to be read, is
  // waited for; timeout_ms below 0: as long as it takes. Thread: setup.
  static Result<FollowedStream> open(const std::string& name, int timeout_ms, Refusal* refusal = nullptr);

  enum class Outcome {
    kFrame,
    kTimeout,  // the writer lives, but published nothing in time
    kEnded,    // the writer ended or stopped, and no other came in time; obstacle() describes the present owner of its
               // name
    kRestarted,  // another writer: reader() is of its object, frames are counted from 0; frames of the old one are
                 // gone unless they are held
  };
  // The next frame in order, or, where that was overwritten, one from the middle of the ring. `missed`: frames between
  // this and the last one given. timeout_ms below 0: as long as it takes. Thread: one at a time.
  Outcome next(BorrowedFrame& frame, std::uint64_t& missed, int timeout_ms);
  // The newest frame that was not given yet. Thread: one at a time.
  Outcome latest(BorrowedFrame& frame, std::uint64_t& missed, int timeout_ms);

  // Switches to another writer that has taken the name; unread frames of the old one are dropped. next() and latest()
  // do it where no frame comes, so that none is lost. False: there is none, or not yet to be read. Thread: one at a
  // time.
  bool follow();

  const ShmReader& reader() const noexcept { return reader_; }
  // Writers followed after the first one.
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

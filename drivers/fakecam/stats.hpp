// Counters of the fake camera since its start.
#pragma once

#include <cstdint>
#include <mutex>

namespace bolo::fakecam {

// Progress of the stream: frames due (sent or withheld by a fault), and the time stamp of the last.
struct StreamPosition {
  std::uint64_t turns = 0;  // over all streams
  std::uint64_t timestamp_ns = 0;
};

struct FakeCameraStats {
  std::uint64_t frames_sent = 0;
  std::uint64_t packets_sent = 0;
  std::uint64_t send_errors = 0;  // packets refused by the socket, and lost
  std::uint64_t late_frames = 0;  // sent more than 1 ms late
  std::uint64_t worst_lateness_ns = 0;
  std::uint64_t resend_requests = 0;
  std::uint64_t resent_packets = 0;
  std::uint64_t resend_misses = 0;     // requests for unavailable frames or packets
  std::uint64_t commands = 0;          // GVCP commands answered or obeyed
  std::uint64_t bad_commands = 0;      // refused or not understood
  std::uint64_t clients = 0;           // times that a client took control
  std::uint64_t heartbeat_losses = 0;  // ... and went silent
  std::uint64_t streams_started = 0;
  std::uint64_t streams_finished = 0;  // ... that reached the capture's end
  std::uint64_t nuc_actions = 0;
  std::uint64_t clock_resets = 0;
  std::uint64_t first_stream_ns = 0;  // CLOCK_MONOTONIC of the first start, the origin of the faults' clock; 0: not yet
  StreamPosition position;
  bool controlled = false;
  bool streaming = false;
};

// The same numbers behind a mutex. Thread: any.
class Counters {
 public:
  void add(std::uint64_t FakeCameraStats::*counter, std::uint64_t n = 1) noexcept {
    const std::lock_guard lock(mutex_);
    stats_.*counter += n;
  }
  template <typename Change>
  void change(Change change) noexcept {
    const std::lock_guard lock(mutex_);
    change(stats_);
  }
  FakeCameraStats read() const noexcept {
    const std::lock_guard lock(mutex_);
    return stats_;
  }

 private:
  mutable std::mutex mutex_;
  FakeCameraStats stats_;
};

}  // namespace bolo::fakecam

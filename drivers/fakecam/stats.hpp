// Counters of the fake camera since it was started.
#pragma once

#include <atomic>
#include <cstdint>
#include <mutex>

namespace bolo::fakecam {

// Progress of the stream: frames that were due, sent or withheld by a fault, and the time stamp of the last.
struct StreamPosition {
  std::uint64_t turns = 0;  // of all streams
  std::uint64_t timestamp_ns = 0;
};

struct FakeCameraStats {
  std::uint64_t frames_sent = 0;
  std::uint64_t packets_sent = 0;
  std::uint64_t send_errors = 0;  // packets that the socket refused: they are lost
  std::uint64_t late_frames = 0;  // sent more than 1 ms after their time
  std::uint64_t worst_lateness_ns = 0;
  std::uint64_t resend_requests = 0;
  std::uint64_t resent_packets = 0;
  std::uint64_t resend_misses = 0;     // requests for frames or packets that are gone or never were
  std::uint64_t commands = 0;          // GVCP commands answered or obeyed
  std::uint64_t bad_commands = 0;      // refused or not understood
  std::uint64_t clients = 0;           // how often a client took control
  std::uint64_t heartbeat_losses = 0;  // ... and went silent
  std::uint64_t streams_started = 0;
  std::uint64_t streams_finished = 0;  // ... that reached the capture's end
  std::uint64_t nuc_actions = 0;
  std::uint64_t first_stream_ns = 0;  // CLOCK_MONOTONIC of the first start: where the faults' clock begins; 0: not yet
  StreamPosition position;
  bool controlled = false;
  bool streaming = false;
};

// The same numbers while the threads count. Each has one writing thread or is only ever added to; readers want no order
// between them, so all accesses are relaxed.
struct Counters {
  using Counter = std::atomic<std::uint64_t>;
  Counter frames_sent{0}, packets_sent{0}, send_errors{0}, late_frames{0}, worst_lateness_ns{0}, resend_requests{0},
      resent_packets{0}, resend_misses{0}, commands{0}, bad_commands{0}, clients{0}, heartbeat_losses{0},
      streams_started{0}, streams_finished{0}, nuc_actions{0}, first_stream_ns{0};
  std::atomic<bool> controlled{false};
  std::atomic<bool> streaming{false};

  static void add(Counter& counter, std::uint64_t n = 1) noexcept { counter.fetch_add(n, std::memory_order_relaxed); }
  // Thread: the counter's only writer.
  static void raise(Counter& counter, std::uint64_t value) noexcept {
    if (value > counter.load(std::memory_order_relaxed)) counter.store(value, std::memory_order_relaxed);
  }
  // Thread: sender. One lock a frame, which keeps the pair together.
  void pass(std::uint64_t timestamp_ns) noexcept {
    const std::lock_guard lock(position_mutex_);
    ++position_.turns;
    position_.timestamp_ns = timestamp_ns;
  }
  FakeCameraStats read() const noexcept;

 private:
  mutable std::mutex position_mutex_;
  StreamPosition position_;
};

inline FakeCameraStats Counters::read() const noexcept {
  constexpr auto kRelaxed = std::memory_order_relaxed;
  FakeCameraStats s;
  s.frames_sent = frames_sent.load(kRelaxed);
  s.packets_sent = packets_sent.load(kRelaxed);
  s.send_errors = send_errors.load(kRelaxed);
  s.late_frames = late_frames.load(kRelaxed);
  s.worst_lateness_ns = worst_lateness_ns.load(kRelaxed);
  s.resend_requests = resend_requests.load(kRelaxed);
  s.resent_packets = resent_packets.load(kRelaxed);
  s.resend_misses = resend_misses.load(kRelaxed);
  s.commands = commands.load(kRelaxed);
  s.bad_commands = bad_commands.load(kRelaxed);
  s.clients = clients.load(kRelaxed);
  s.heartbeat_losses = heartbeat_losses.load(kRelaxed);
  s.streams_started = streams_started.load(kRelaxed);
  s.streams_finished = streams_finished.load(kRelaxed);
  s.nuc_actions = nuc_actions.load(kRelaxed);
  s.first_stream_ns = first_stream_ns.load(kRelaxed);
  {
    const std::lock_guard lock(position_mutex_);
    s.position = position_;
  }
  s.controlled = controlled.load(kRelaxed);
  s.streaming = streaming.load(kRelaxed);
  return s;
}

}  // namespace bolo::fakecam

// Times in the pipeline: nanoseconds of CLOCK_MONOTONIC.
#pragma once

#include <chrono>
#include <cmath>
#include <cstdint>
#include <string>

namespace bolo {

// std::chrono::steady_clock is CLOCK_MONOTONIC on Linux: comparable across processes. Thread: any.
inline std::int64_t monotonic_ns() noexcept {
  return std::chrono::duration_cast<std::chrono::nanoseconds>(std::chrono::steady_clock::now().time_since_epoch())
      .count();
}

inline constexpr double kNsPerSecond = 1e9;
inline constexpr double kMsPerNs = 1e-6;
inline constexpr std::int64_t kNsPerMs = 1'000'000;
inline constexpr std::int64_t kNsPerUs = 1000;

// Bound of clock times, 73 years: differences of times within it do not overflow.
inline constexpr std::int64_t kMostClockNs = std::int64_t{1} << 61U;

// To the nearest nanosecond. Thread: any.
inline std::int64_t to_ns(double seconds) noexcept { return std::llround(seconds * kNsPerSecond); }

// --- UTC for times of CLOCK_MONOTONIC, with its uncertainty.

// Error of an undisciplined clock: unbounded, which the kernel reports as its largest value, 16 s.
inline constexpr std::int64_t kUnboundedClockErrorNs = 16'000'000'000;

// The kernel's state of CLOCK_REALTIME (adjtimex), set by whatever disciplines it: an NTP client, phc2sys, a receiver.
struct ClockState {
  bool synchronised = false;
  std::int64_t error_ns = kUnboundedClockErrorNs;  // bound of the UTC error, as the disciplining program claims
};

// One system call; where a sandbox refuses it, the clock counts as not synchronised. Thread: any.
ClockState read_clock_state() noexcept;

// CLOCK_REALTIME, ns since 1970. Thread: any.
std::int64_t realtime_ns() noexcept;

// Processor time of the calling thread. Thread: any.
std::int64_t thread_cpu_ns() noexcept;

// "2026-11-23T19:31:02.123Z": ISO 8601, cut to the millisecond. Thread: any.
std::string utc_text(std::int64_t utc_ns);

// A larger change of UTC against CLOCK_MONOTONIC is a step: the clock was set. Smaller changes are reading errors.
// (Slewing moves both clocks alike.)
inline constexpr std::int64_t kClockStepNs = 1'000'000;

// Clocks that UtcClock reads; replaced in tests.
struct HostClocks {
  std::int64_t (*monotonic)() noexcept = monotonic_ns;
  std::int64_t (*realtime)() noexcept = realtime_ns;
  ClockState (*state)() noexcept = read_clock_state;
};

// Offset from CLOCK_MONOTONIC to UTC. It changes only when the clock is set, so that two frames differ by the same time
// in UTC and monotonic, except across a step. Thread: one at a time. No allocation.
class UtcClock {
 public:
  explicit UtcClock(HostClocks clocks = {}) noexcept : clocks_(clocks) {}

  // Reads the clock once; once a second it reads more carefully, and the clock's state. now_ns: CLOCK_MONOTONIC, just
  // read. True if the clock has stepped since the last call.
  bool update(std::int64_t now_ns) noexcept;

  std::int64_t at(std::int64_t monotonic) const noexcept { return monotonic + offset_ns_; }
  const ClockState& state() const noexcept { return state_; }

 private:
  struct Reading {
    std::int64_t offset_ns = 0;  // UTC - CLOCK_MONOTONIC
    std::int64_t error_ns = 0;
  };
  Reading read() const noexcept;

  HostClocks clocks_;
  ClockState state_;
  bool started_ = false;
  std::int64_t read_ns_ = 0;
  std::int64_t offset_ns_ = 0;
  std::int64_t error_ns_ = 0;
};

}  // namespace bolo

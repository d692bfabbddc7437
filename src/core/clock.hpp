// Time as the pipeline counts it: nanoseconds of CLOCK_MONOTONIC.
#pragma once

#include <chrono>
#include <cmath>
#include <cstdint>

namespace bolo {

// std::chrono::steady_clock is CLOCK_MONOTONIC on Linux, so other processes can compare. Thread: any.
inline std::int64_t monotonic_ns() noexcept {
  return std::chrono::duration_cast<std::chrono::nanoseconds>(std::chrono::steady_clock::now().time_since_epoch())
      .count();
}

inline constexpr double kNsPerSecond = 1e9;
inline constexpr double kMsPerNs = 1e-6;

// To the nearest nanosecond. Thread: any.
inline std::int64_t to_ns(double seconds) noexcept { return std::llround(seconds * kNsPerSecond); }

}  // namespace bolo

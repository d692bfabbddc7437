// Limits of the time that a source may be silent.
#pragma once

#include <cstdint>

namespace bolo::pipeline {

struct WatchLimits {
  std::int64_t stall_ns;  // without a frame for this long: stalled
  std::int64_t lost_ns;   // ... and for this long: lost
};

// From the configuration, but at least 20 frame periods. Thread: any.
WatchLimits watch_limits(int stall_ms, int reconnect_after_ms, double period_s) noexcept;

// Frames that would have come between the last one before an outage and the first one after it. Thread: any.
std::uint64_t frames_between(std::int64_t last_ns, std::int64_t first_ns, double period_s) noexcept;

}  // namespace bolo::pipeline

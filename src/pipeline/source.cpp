#include "src/pipeline/source.hpp"

#include <algorithm>
#include <cmath>

#include "src/core/clock.hpp"

namespace bolo::pipeline {
namespace {

constexpr double kStallPeriods = 20.0;

}  // namespace

WatchLimits watch_limits(int stall_ms, int reconnect_after_ms, double period_s) noexcept {
  const auto periods_ns = static_cast<std::int64_t>(kStallPeriods * period_s * kNsPerSecond);
  const std::int64_t stall_ns = std::max(stall_ms * kNsPerMs, periods_ns);
  return {.stall_ns = stall_ns, .lost_ns = std::max(reconnect_after_ms * kNsPerMs, stall_ns)};
}

std::uint64_t frames_between(std::int64_t last_ns, std::int64_t first_ns, double period_s) noexcept {
  const double periods = static_cast<double>(first_ns - last_ns) / (period_s * kNsPerSecond);
  return static_cast<std::uint64_t>(std::max(0.0, std::round(periods) - 1.0));
}

double known_period_s(const SourceStatus& status, double stated_s) noexcept {
  const double measured_s = status.measured_period_s.value();
  return measured_s > 0.0 ? measured_s : stated_s;
}

}  // namespace bolo::pipeline

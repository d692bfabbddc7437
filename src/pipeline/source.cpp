#include "src/pipeline/source.hpp"

#include <algorithm>
#include <cmath>
#include <iterator>

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

void Notices::report(bool warning, std::string text, std::string_view event) {
  const std::lock_guard lock(mutex_);
  if (text == last_) return;
  last_ = text;
  if (waiting_.size() == kMost) waiting_.pop_front();
  waiting_.push_back({warning, std::move(text), event});
}

void Notices::forget_last() {
  const std::lock_guard lock(mutex_);
  last_.clear();
}

std::vector<Notice> Notices::take() {
  const std::lock_guard lock(mutex_);
  const std::deque<Notice> taken = std::exchange(waiting_, {});
  return {std::make_move_iterator(taken.begin()), std::make_move_iterator(taken.end())};
}

}  // namespace bolo::pipeline

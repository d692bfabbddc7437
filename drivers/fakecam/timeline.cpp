#include "drivers/fakecam/timeline.hpp"

#include <algorithm>
#include <cmath>

#include "src/core/clock.hpp"

namespace bolo::fakecam {
namespace {

std::int64_t to_ns(double seconds) { return std::llround(seconds * kNsPerSecond); }

// The counter's step from one frame to the next when none is lost: 1, or more in a thinned-out capture.
std::uint64_t smallest_step(std::span<const std::uint64_t> ids) {
  std::uint64_t step = ids.size() < 2 ? 1 : ids[1] - ids[0];
  for (std::size_t i = 1; i < ids.size(); ++i) step = std::min(step, ids[i] - ids[i - 1]);
  return std::max<std::uint64_t>(step, 1);
}

}  // namespace

Timeline::Timeline(std::span<const std::uint64_t> frame_ids, std::span<const double> times_s, double period_s,
                   double rate_hz)
    : ids_(frame_ids.begin(), frame_ids.end()) {
  const std::uint64_t step = smallest_step(ids_);
  times_ns_.reserve(ids_.size());
  for (std::size_t i = 0; i < ids_.size(); ++i) {
    const double frames = static_cast<double>(ids_[i] - ids_.front()) / static_cast<double>(step);
    times_ns_.push_back(rate_hz > 0.0 ? to_ns(times_s.front()) + to_ns(frames / rate_hz) : to_ns(times_s[i]));
  }
  lap_ids_ = ids_.back() - ids_.front() + step;
  lap_ns_ = times_ns_.back() - times_ns_.front() + to_ns(rate_hz > 0.0 ? 1.0 / rate_hz : period_s);
}

Moment Timeline::at(std::uint64_t sequence) const {
  const std::uint64_t lap = sequence / ids_.size();
  const auto index = static_cast<std::size_t>(sequence % ids_.size());
  return {index, ids_[index] + lap * lap_ids_,
          static_cast<std::uint64_t>(times_ns_[index] + static_cast<std::int64_t>(lap) * lap_ns_)};
}

}  // namespace bolo::fakecam

#include "tools/demo/truth_clock.hpp"

#include <algorithm>
#include <cmath>

#include "src/core/clock.hpp"

namespace bolo::tools {

TruthClock::TruthClock(const std::vector<double>& t, double period_s)
    : t_(t), period_s_(period_s), first_s_(t.front()), lap_s_(t.back() - t.front() + period_s) {
  for (double& time : t_) time -= first_s_;
}

std::optional<std::size_t> TruthClock::frame_at(std::int64_t camera_ns) const {
  const double since_first = static_cast<double>(camera_ns) / kNsPerSecond - first_s_;
  if (since_first < -period_s_ / 4) return std::nullopt;
  // A quarter period early, so that rounding cannot push a lap's first frame to the end of the lap before.
  const double in_lap = std::fmod(since_first + period_s_ / 4, lap_s_) - period_s_ / 4;
  const auto after = std::lower_bound(t_.begin(), t_.end(), in_lap - period_s_ / 4);
  if (after == t_.end() || std::abs(*after - in_lap) > period_s_ / 4) return std::nullopt;
  return static_cast<std::size_t>(after - t_.begin());
}

}  // namespace bolo::tools

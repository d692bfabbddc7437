#include "tools/lab/detect/bootstrap.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

#include "src/core/splitmix.hpp"

namespace bolo::tools::detect {
namespace {

double quantile(const std::vector<double>& sorted, double share) {
  const double place = share * static_cast<double>(sorted.size() - 1);
  const auto below = static_cast<std::size_t>(place);
  const std::size_t above = std::min(below + 1, sorted.size() - 1);
  return std::lerp(sorted[below], sorted[above], place - static_cast<double>(below));
}

}  // namespace

std::vector<int> drawn_scenes(std::size_t scenes, std::uint64_t seed, std::uint64_t draw) {
  std::vector<int> times(scenes, 0);
  const std::uint64_t key = splitmix::key(seed, draw);
  for (std::size_t i = 0; i < scenes; ++i) {
    const double at = splitmix::unit(splitmix::key(key, i)) * static_cast<double>(scenes);
    ++times[std::min(static_cast<std::size_t>(at), scenes - 1)];
  }
  return times;
}

Interval interval_95(std::vector<double> values) {
  std::erase_if(values, [](double value) { return !std::isfinite(value); });
  constexpr double kNone = std::numeric_limits<double>::quiet_NaN();
  if (values.empty()) return {kNone, kNone};
  std::ranges::sort(values);
  constexpr double kTail = 0.025;
  return {quantile(values, kTail), quantile(values, 1.0 - kTail)};
}

}  // namespace bolo::tools::detect

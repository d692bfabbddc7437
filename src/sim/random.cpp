#include "src/sim/random.hpp"

#include <algorithm>

namespace bolo::sim {

std::vector<double> normal_plane(std::uint64_t seed, Geometry geometry) {
  std::vector<double> plane(geometry.pixels());
  const auto width = static_cast<std::size_t>(geometry.width);
  for (std::size_t y = 0; y < static_cast<std::size_t>(geometry.height); ++y) {
    fill_normal(seed, 0, y, std::span(plane).subspan(y * width, width));
  }
  return plane;
}

// Floyd's sampling (Bentley and Floyd, "A sample of brilliance", 1987).
std::vector<std::size_t> choose(std::uint64_t seed, std::size_t size, std::size_t count) {
  SplitMix random(seed);
  std::vector<std::size_t> chosen;
  for (std::size_t i = size - std::min(size, count); i < size; ++i) {
    const auto candidate = static_cast<std::size_t>(unit(random.next()) * static_cast<double>(i + 1));
    const auto place = std::ranges::lower_bound(chosen, candidate);
    const bool taken = place != chosen.end() && *place == candidate;
    if (taken) {
      chosen.push_back(i);  // larger than all before
    } else {
      chosen.insert(place, candidate);
    }
  }
  return chosen;
}

}  // namespace bolo::sim

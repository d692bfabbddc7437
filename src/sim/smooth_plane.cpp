#include "src/sim/smooth_plane.hpp"

#include <cmath>
#include <numbers>

#include "src/sim/random.hpp"

namespace bolo::sim {
namespace {

template <typename Value>
std::vector<double> plane_of(Geometry geometry, Value value) {
  std::vector<double> plane;
  plane.reserve(geometry.pixels());
  for (int y = 0; y < geometry.height; ++y) {
    for (int x = 0; x < geometry.width; ++x) {
      plane.push_back(value((x + 0.5) / geometry.width, (y + 0.5) / geometry.height));
    }
  }
  return standardised(std::move(plane));
}

}  // namespace

std::vector<double> standardised(std::vector<double> values) {
  double mean = 0.0;
  for (const double value : values) mean += value / static_cast<double>(values.size());
  double variance = 0.0;
  for (const double value : values) variance += (value - mean) * (value - mean) / static_cast<double>(values.size());
  const double scale = variance > 0.0 ? 1.0 / std::sqrt(variance) : 0.0;
  for (double& value : values) value = (value - mean) * scale;
  return values;
}

std::vector<double> smooth_plane(std::uint64_t seed, Geometry geometry) {
  constexpr int kWaves = 3;  // up to so many half periods along each side
  std::vector<double> weights(static_cast<std::size_t>((kWaves + 1) * (kWaves + 1)));
  fill_normal(seed, 2, 0, weights);
  return plane_of(geometry, [&weights](double x, double y) {
    double sum = 0.0;
    for (int i = 0; i <= kWaves; ++i) {
      for (int j = 0; j <= kWaves; ++j) {
        const double weight = weights[static_cast<std::size_t>(i * (kWaves + 1) + j)] / (1.0 + i * i + j * j);
        sum += weight * std::cos(std::numbers::pi * i * x) * std::cos(std::numbers::pi * j * y);
      }
    }
    return sum;
  });
}

std::vector<double> gradient_plane(std::uint64_t seed, Geometry geometry) {
  const double direction = SplitMix(key(seed, 3)).between(0.0, 2.0 * std::numbers::pi);
  return plane_of(geometry,
                  [direction](double x, double y) { return std::cos(direction) * x + std::sin(direction) * y; });
}

}  // namespace bolo::sim

#include "src/sim/random.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "src/core/statistics.hpp"

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

void fill_normal(std::uint64_t seed, std::uint64_t frame, std::uint64_t row, std::span<double> out) noexcept {
  SplitMix random(key(key(key(0, seed), frame), row));
  for (std::size_t i = 0; i < out.size(); i += 2) {
    const double radius = std::sqrt(-2.0 * std::log(1.0 - unit(random.next())));
    const double angle = 2.0 * std::numbers::pi * unit(random.next());
    out[i] = radius * std::cos(angle);
    if (i + 1 < out.size()) out[i + 1] = radius * std::sin(angle);
  }
}

// Bailey, "Polar generation of random variates with the t-distribution", 1994.
void fill_student(std::uint64_t seed, double degrees, std::span<double> out) noexcept {
  SplitMix random(seed);
  const double unit_variance = std::sqrt((degrees - 2.0) / degrees);
  for (double& value : out) {
    const double u = 1.0 - unit(random.next());
    const double angle = 2.0 * std::numbers::pi * unit(random.next());
    value = unit_variance * std::sqrt(degrees * (std::pow(u, -2.0 / degrees) - 1.0)) * std::cos(angle);
  }
}

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

std::vector<double> standardised(std::vector<double> values) {
  const auto count = static_cast<double>(values.size());
  const double mean = sum_of(values, [=](double value) { return value / count; });
  const double variance = sum_of(values, [=](double value) { return (value - mean) * (value - mean) / count; });
  const double scale = variance > 0.0 ? 1.0 / std::sqrt(variance) : 0.0;
  for (double& value : values) value = (value - mean) * scale;
  return values;
}

std::vector<double> smooth_plane(std::uint64_t seed, Geometry geometry) {
  constexpr int kWaves = 3;  // maximum number of half periods along each side
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

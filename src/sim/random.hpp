// Random numbers of the simulator: keyed (SplitMix64), so that any thread can generate any row.
#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <string_view>
#include <vector>

#include "src/core/frame.hpp"
#include "src/core/splitmix.hpp"

namespace bolo::sim {

using splitmix::key;
using splitmix::kGolden;
using splitmix::mix;
using splitmix::unit;

// A stream of random numbers that starts at a key.
class SplitMix {
 public:
  explicit constexpr SplitMix(std::uint64_t seed) noexcept : state_(seed) {}
  constexpr std::uint64_t next() noexcept { return mix(state_ += kGolden); }

  constexpr double between(double low, double high) noexcept { return low + (high - low) * unit(next()); }
  constexpr bool chance(double probability) noexcept { return unit(next()) < probability; }

 private:
  std::uint64_t state_;
};

// A distinct key for a name. Thread: any.
constexpr std::uint64_t name_key(std::string_view name, std::uint64_t seed) noexcept {
  std::uint64_t value = key(0x6566666563747321ULL, seed);
  for (const char c : name) value = key(value, static_cast<unsigned char>(c));
  return value;
}

// Standard normal values that depend only on the three keys (Box-Muller transform). Thread: any.
void fill_normal(std::uint64_t seed, std::uint64_t frame, std::uint64_t row, std::span<double> out) noexcept;

// One standard normal value for a key. Thread: any.
inline double normal(std::uint64_t seed, std::uint64_t counter = 0) noexcept {
  std::array<double, 1> value{};
  fill_normal(seed, counter, 0, value);
  return value[0];
}

// Student's t distribution with unit variance. Thread: any.
void fill_student(std::uint64_t seed, double degrees, std::span<double> out) noexcept;

// `count` distinct numbers of [0, size), increasing. Thread: any.
std::vector<std::size_t> choose(std::uint64_t seed, std::size_t size, std::size_t count);

// Fixed patterns, row-major. Thread: any.
std::vector<double> normal_plane(std::uint64_t seed, Geometry geometry);
// Smooth: sum of low-frequency cosine waves; gradient: slope in a random direction. Both have mean 0, variance 1.
std::vector<double> smooth_plane(std::uint64_t seed, Geometry geometry);
std::vector<double> gradient_plane(std::uint64_t seed, Geometry geometry);
// Shifts and scales the values to mean 0 and variance 1 (all 0 if they are equal).
std::vector<double> standardised(std::vector<double> values);

}  // namespace bolo::sim

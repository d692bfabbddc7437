// Random numbers of the effects: keyed, so that any thread may make any row.
#pragma once

#include <array>
#include <cmath>
#include <cstdint>
#include <numbers>
#include <span>
#include <string_view>
#include <vector>

#include "src/core/geometry.hpp"
#include "src/sim/readout.hpp"
#include "src/sim/splitmix.hpp"

namespace bolo::sim {

// A key of its own for a name. Thread: any.
constexpr std::uint64_t name_key(std::string_view name, std::uint64_t seed) noexcept {
  std::uint64_t value = key(0x6566666563747321ULL, seed);
  for (const char c : name) value = key(value, static_cast<unsigned char>(c));
  return value;
}

// One standard normal value of a key. Thread: any.
inline double normal(std::uint64_t seed, std::uint64_t counter = 0) noexcept {
  std::array<double, 1> value{};
  fill_normal(seed, counter, 0, value);
  return value[0];
}

// Standard normal values of a whole plane, row by row. Thread: any.
std::vector<double> normal_plane(std::uint64_t seed, Geometry geometry);

// `count` different numbers of [0, size), rising. Thread: any.
std::vector<std::size_t> choose(std::uint64_t seed, std::size_t size, std::size_t count);

}  // namespace bolo::sim

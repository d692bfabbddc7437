// Random numbers of the simulator: those of core, and streams of them.
#pragma once

#include <cstdint>

#include "src/core/splitmix.hpp"

namespace bolo::sim {

using splitmix::key;
using splitmix::kGolden;
using splitmix::mix;
using splitmix::unit;

// A stream of random numbers that begins at a key.
class SplitMix {
 public:
  explicit constexpr SplitMix(std::uint64_t seed) noexcept : state_(seed) {}
  constexpr std::uint64_t next() noexcept { return mix(state_ += kGolden); }

  constexpr double between(double low, double high) noexcept { return low + (high - low) * unit(next()); }
  constexpr bool chance(double probability) noexcept { return unit(next()) < probability; }

 private:
  std::uint64_t state_;
};

}  // namespace bolo::sim

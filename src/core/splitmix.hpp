// SplitMix64 (Steele, Lea and Flood, "Fast Splittable Pseudorandom Number Generators", 2014): one random number per
// counter, so that any part of a random sequence can be generated on its own.
#pragma once

#include <cstdint>

namespace bolo::splitmix {

inline constexpr std::uint64_t kGolden = 0x9e3779b97f4a7c15ULL;

constexpr std::uint64_t mix(std::uint64_t z) noexcept {
  z = (z ^ (z >> 30)) * 0xbf58476d1ce4e5b9ULL;
  z = (z ^ (z >> 27)) * 0x94d049bb133111ebULL;
  return z ^ (z >> 31);
}

// Derives a key from another key and a counter. Thread: any.
constexpr std::uint64_t key(std::uint64_t above, std::uint64_t counter) noexcept {
  return mix(above + (counter + 1) * kGolden);
}

// Maps the top 53 bits to [0, 1). Thread: any.
constexpr double unit(std::uint64_t random) noexcept { return static_cast<double>(random >> 11) * 0x1p-53; }

}  // namespace bolo::splitmix

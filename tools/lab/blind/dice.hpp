// Random draws that depend on nothing but a seed.
#pragma once

#include <cmath>
#include <cstddef>
#include <cstdint>

namespace bolo::tools::blind {

// SplitMix64's mixing of one word. Thread: any.
constexpr std::uint64_t mix(std::uint64_t word) noexcept {
  word += 0x9E3779B97F4A7C15U;
  word = (word ^ (word >> 30U)) * 0xBF58476D1CE4E5B9U;
  word = (word ^ (word >> 27U)) * 0x94D049BB133111EBU;
  return word ^ (word >> 31U);
}

class Dice {
 public:
  explicit Dice(std::uint64_t seed) noexcept : state_(seed) {}

  std::uint64_t word() noexcept {
    state_ += 0x9E3779B97F4A7C15U;
    return mix(state_);
  }
  // In [0, 1).
  double unit() noexcept { return static_cast<double>(word() >> 11U) * 0x1p-53; }
  double between(double low, double high) noexcept { return low + (high - low) * unit(); }
  // Below `count`, which is at least 1.
  std::size_t below(std::size_t count) noexcept { return static_cast<std::size_t>(word() % count); }
  // Uniform in size between the two, of either sign.
  double signed_between(double low, double high) noexcept {
    const double size = between(low, high);
    return unit() < 0.5 ? -size : size;
  }

 private:
  std::uint64_t state_;
};

}  // namespace bolo::tools::blind

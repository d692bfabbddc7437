// From what the pixels show to stored values: noise, then quantisation.
#pragma once

#include <cstdint>
#include <span>

#include "src/core/plane.hpp"

namespace bolo::sim {

// Standard normal values that depend only on the three keys: any thread may make any row. Box and Muller's transform of
// SplitMix64. Thread: any.
void fill_normal(std::uint64_t seed, std::uint64_t frame, std::uint64_t row, std::span<double> out) noexcept;

struct ReadoutSettings {
  double noise_k = 0.03;         // rms of white Gaussian noise, K
  double quantisation_k = 0.01;  // K a step; 0: none (float32 only)
  PixelType type = PixelType::kUint16;
  std::uint64_t seed = 1;
};

// uint16: kelvin = quantisation_k * value, clipped to the 16 bits; float32: kelvin, in multiples of quantisation_k.
LinearScale readout_scale(const ReadoutSettings& settings);

// Stores one row. `kelvin` holds what the pixels show and gets the noise added; `noise` is working space of its size;
// `out` has kelvin.size() values of the settings' type. Thread: any, different rows at once.
void read_row(const ReadoutSettings& settings, std::uint64_t frame, int row, std::span<double> kelvin,
              std::span<double> noise, void* out) noexcept;

}  // namespace bolo::sim

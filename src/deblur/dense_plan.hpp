// The problem with bins longer than a frame (2^levels < N), or a number of iterations that was asked for: full
// matrices.
#pragma once

#include <Eigen/Dense>

#include "src/deblur/grid.hpp"
#include "src/deblur/tuning.hpp"

namespace bolo::deblur {

inline constexpr int kMaxDenseBins = 64;

// With the coefficients D = H x and S = G H^T, ADMM's x-update D = (S^T M S + rho I)^-1 (S^T M Y + rho (z - u)) is
// data * y + feedback * (z - u); y are the samples less their mean.
struct DensePlan {
  int bins = 0;
  int iterations = 0;
  float alpha = 1.0F;
  float lambda = 0.0F;     // lambda_half of pixels that bring none of their own, in the units of the values
  float threshold = 0.0F;  // for a lambda_half of 1
  float inverse_count = 0.0F;
  int samples = 0;
  std::array<int, kMaxSlots> slot{};
  std::array<std::array<float, kMaxDenseBins>, kMaxSlots> data{};   // [sample][coefficient]
  std::array<std::array<float, kMaxDenseBins>, kMaxSlots> start{};  // least squares: where the iteration begins
  std::array<std::array<float, kMaxDenseBins>, kMaxDenseBins> feedback{};
  std::array<std::array<float, kMaxDenseBins>, kMaxDenseBins> basis{};  // [bin][coefficient]: x of a bin is basis . D
};

// No allocation. Thread: pipeline.
void prepare(DensePlan& plan, const Grid& grid, const Tuning& tuning, const Pattern& pattern) noexcept;

}  // namespace bolo::deblur

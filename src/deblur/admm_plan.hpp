// ADMM started from the dual of the sweeps: one iteration, of which only the published value is computed.
//
// D = c - Q t and u = t / rho give w = D + u, z = soft(w) and u = clip(w); the x-update that follows (below) is
// linear in the samples and z - u, so each bin's x is a row of weights.
#pragma once

#include <Eigen/Dense>

#include "src/deblur/dual_plan.hpp"
#include "src/deblur/grid.hpp"
#include "src/deblur/tuning.hpp"

namespace bolo::deblur {

// --- The problem with bins longer than a frame (2^levels < N), or with a given number of iterations: full matrices.

inline constexpr int kMaxDenseBins = 64;

// With the coefficients D = H x and S = G H^T, ADMM's x-update D = (S^T M S + rho I)^-1 (S^T M Y + rho (z - u)) is
// data * y + feedback * (z - u); y are the samples less their mean.
struct DensePlan {
  int bins = 0;
  int iterations = 0;
  float alpha = 1.0F;
  float lambda = 0.0F;     // lambda_half, in the values' units, for pixels without one of their own
  float threshold = 0.0F;  // for a lambda_half of 1
  float inverse_count = 0.0F;
  int samples = 0;
  std::array<int, kMaxSlots> slot{};
  std::array<std::array<float, kMaxDenseBins>, kMaxSlots> data{};   // [sample][coefficient]
  std::array<std::array<float, kMaxDenseBins>, kMaxSlots> start{};  // least squares: start of the iteration
  std::array<std::array<float, kMaxDenseBins>, kMaxDenseBins> feedback{};
  std::array<std::array<float, kMaxDenseBins>, kMaxDenseBins> basis{};  // [bin][coefficient]: x of a bin is basis . D
};

// No allocation. Thread: pipeline.
void prepare(DensePlan& plan, const Grid& grid, const Tuning& tuning, const Pattern& pattern) noexcept;

// In the units and the order of DualPlan.
struct AdmmPlan {
  DualPlan start;
  DensePlan dense;                                // the x-update
  std::array<float, kMaxDualBins> keep{};         // of t_i in w_i
  std::array<float, kMaxDualLevels> threshold{};  // of w_i by level, for a lambda_half of 1
};

// No allocation. Thread: pipeline.
void prepare(AdmmPlan& plan, const Grid& grid, const Tuning& tuning, const Pattern& pattern) noexcept;

// Thread: worker.
Estimate admm_estimate(const AdmmPlan& plan, const Published& bins) noexcept;

}  // namespace bolo::deblur

// ADMM from the dual that the sweeps leave: one iteration, of which only the published value is computed.
//
// D = c - Q t and u = t / rho give w = D + u, z = soft(w) and u = clip(w); the x-update that follows (dense_plan.hpp)
// is linear in the samples and z - u, so each bin's x is a row of weights.
#pragma once

#include "src/deblur/dense_plan.hpp"
#include "src/deblur/dual_plan.hpp"

namespace bolo::deblur {

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

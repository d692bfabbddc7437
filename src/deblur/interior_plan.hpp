// Slow cameras (T / tau above 2.1): the paper's problem where wavelets within a frame interval can be used.
//
// Of the wavelets within frame interval i only the strongest can be non-zero, and it changes the samples exactly as the
// interval's mean input x_i does, G e_i, but |g| times as much (WithinFrame). With f_i its part of the effective input
// s = x + f, the 2^levels unknowns reduce to two for each frame interval:
//   minimise 1/2 ||G s - Y||^2 + lambda_s ||H x||_1 + lambda / |g| ||f||_1,   lambda_s = lambda_scale lambda.
// Its dual is a box in the basis of H and one in that of the bins:
//   minimise 1/2 v^T Q v - h^T v  over  |H v| <= lambda_s, |v_i| <= lambda / |g|,   Q = B B^T / p^2, h = G^-1 Y
// (dual_plan.hpp); c = H x and f are the multipliers of its bounds. Where lambda is small, first-order methods need
// hundreds of iterations, an interior point (interior_kernel.cpp) eleven Newton steps, whatever the data. Each solves
//   (diag Q + H^T D_H H + D_f) step = residual
// by elimination along the tree of wavelets, in as many operations as a few Haar transforms; the off-diagonal part of Q
// (at most a / (1 + a^2) = 0.12 of the diagonal) is only in the residual, and vanishes after a few steps.
//
// A lost sample j has no residual: v_j = a v_{j+1}, with a free multiplier e_j in place of the sample, which borders
// each step's system. With several, each leaf is held one step behind v_{j+1} and passes -a e_j on: nearly the optimum.
//
// The optimum need not be unique here: ties in the data then leave a face of equally good inputs, of which this method
// finds the centre, and the exact method's path an edge.
#pragma once

#include <array>

#include "src/deblur/dual_plan.hpp"
#include "src/deblur/kernels.hpp"

namespace bolo::deblur {

// Constants of the interval that ends with sample i + 1.
struct InteriorRow {
  float weight = 0.0F;    // 1; 0 if the sample was lost, or is not after the reference
  float diagonal = 0.0F;  // Q_ii
  float limit = 0.0F;     // of |t|, t of the wavelet with its middle at bin i, in units of lambda_s; of row 0: the sum
  float carry = 0.0F;     // a if v_i = a v_{i+1}; 0 for other lost ones: v_i = 0
};

struct InteriorPlan {
  int bins = 0;  // frame intervals
  int parts = 0;
  int steps = 0;
  int border = -1;            // the row with a carry, if there is exactly one
  float lambda = 0.0F;        // lambda_half, in the values' units, for pixels without one of their own
  float lambda_scale = 0.0F;  // lambda_s for a lambda_half of 1
  float bound = 0.0F;         // of v_i, in units of lambda_s
  float overshoot = 0.0F;     // of the wavelet's half that ends the interval, for f = 1
  float decay = 0.0F;         // a
  float curvature = 0.0F;     // 1 / p^2
  float inverse_gain = 0.0F;  // the input x_j = y_{j+1} + inverse_gain (y_{j+1} - y_j)
  float inverse_count = 0.0F;
  std::array<InteriorRow, kMaxDualBins> row{};
  std::array<SlotValue, kMaxSlots> value{};
};

// `grid` has parts > 1. Thread: setup.
InteriorPlan make_interior_plan(const Settings& settings, const Grid& grid);

// No allocation. Thread: pipeline.
void prepare(InteriorPlan& plan, const Grid& grid, const Pattern& pattern) noexcept;

}  // namespace bolo::deblur

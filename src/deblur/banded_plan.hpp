// Everything about the structured problem that is the same for all pixels: made once per pattern of lost frames.
//
// With s = G x / p (p = 1 - a, a the decay over a bin) the recursion y_{j+1} = a y_j + p x_j reads x = B s, B
// bidiagonal with 1 on and -a below the diagonal, whatever samples are missing. ADMM's x-update
//   minimise 1/2 ||M (G x - Y)||^2 + rho/2 ||x - v||^2
// becomes (p^2/rho M + B^T B) s = (p/rho) M Y + B^T v: a symmetric tridiagonal system, factored here (twisted L D L^T).
#pragma once

#include <array>
#include <vector>

#include "src/deblur/dual_plan.hpp"

namespace bolo::deblur {

// Row j of the tridiagonal system, scaled so that its pivot is 1. Elimination runs from both ends to the middle row, so
// that two chains of dependent operations run side by side; "inner" is the neighbour on the middle's side.
struct RowCoefficients {
  float weight = 0.0F;      // of the row's sample in the right side; 0 where there is none
  float decay = 0.0F;       // of the reference until that sample
  float own = 0.0F;         // of v_j in the right side: 1 / pivot
  float next = 0.0F;        // of -v_{j+1}: a / pivot
  float eliminate = 0.0F;   // multiple of row j that is subtracted from the inner row
  float substitute = 0.0F;  // multiple of the inner s that is subtracted from this row's
  float next_decay = 0.0F;  // a of the row after; 0 for the last and where the reference starts afresh
  float threshold = 0.0F;   // of coefficient j for a lambda_half of 1, see BandedPlan
  float step = 0.0F;        // alpha / support of coefficient j
};

// Coefficients of the Haar transform stand in the order of the in-place butterflies: index i != 0 is the wavelet of
// support 2 (i & -i) that begins at i - (i & -i); 0 is the scaling coefficient. They are sums and differences without
// normalisation, divided by their support, so that the inverse transform needs no multiplication: thresholds scale by
// 1 / sqrt(support).
struct BandedPlan {
  DualPlan start;       // sweeps on the dual, from which it goes on
  float scaled = 0.0F;  // u = scaled lambda t: 1 / rho
  int reference = 0;    // slot of y_0
  int bins = 0;
  int iterations = 0;
  float alpha = 1.0F;       // over-relaxation
  float lambda = 0.0F;      // lambda_half of pixels that bring none of their own, in the units of the values
  float inverse_count = 0;  // 1 / received samples
  std::vector<RowCoefficients> row;
  std::vector<double> diagonal;  // pivots, once factored
};

// Takes the memory for `grid`. Thread: setup.
BandedPlan make_banded_plan(const Grid& grid);

// No allocation. Thread: pipeline.
void prepare(BandedPlan& plan, const Grid& grid, const Tuning& tuning, const Pattern& pattern) noexcept;

}  // namespace bolo::deblur

// The paper's problem without approximation, on any settings and any pattern of lost frames.
#pragma once

#include <array>
#include <span>

#include "src/deblur/grid.hpp"
#include "src/deblur/lasso.hpp"

namespace bolo::deblur {

// Columns of V H^T that can be non-zero: min(2^levels, N) frame-level ones and, outside the reduction, the strongest
// wavelet of each frame.
using Columns = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::ColMajor, kMaxSlots, kMaxColumns>;

struct ExactPlan {
  double lambda = 0.0;  // half-square, in the units of the values
  int samples = 0;
  std::array<int, kMaxSlots> slot{};
  std::array<double, kMaxSlots> decay{};  // of the reference until the sample
  Columns z;                              // one row for each sample after the reference
  Coefficients publish;                   // the estimate is publish . D
  Lasso lasso;
};

// lambda_half in the units of the values. No allocation. Thread: pipeline.
void prepare(ExactPlan& plan, const Settings& settings, double lambda_half, const Pattern& pattern) noexcept;

// One pixel: y holds its received samples in the order of time. Thread: worker.
double solve(const ExactPlan& plan, std::span<const double> y) noexcept;

}  // namespace bolo::deblur

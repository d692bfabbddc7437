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
  double lambda = 0.0;  // lambda_half of pixels that bring none of their own, in the units of the values
  int bins = 0;         // frame-level columns
  double repeat = 1.0;  // bins of the full problem that one of them stands for
  WithinFrame within;   // the columns after them, one a frame, when used
  int samples = 0;
  std::array<int, kMaxSlots> slot{};
  std::array<double, kMaxSlots> decay{};  // of the reference until the sample
  Columns z;                              // one row for each sample after the reference
  Lasso lasso;
};

// lambda_half in the units of the values. No allocation. Thread: pipeline.
void prepare(ExactPlan& plan, const Settings& settings, double lambda_half, const Pattern& pattern) noexcept;

// One pixel's coefficients D: y holds its received samples in the order of time, less `mean`. Thread: worker.
void solve(const ExactPlan& plan, std::span<const double> y, double lambda_half, Coefficients& d) noexcept;

// The published value is publish_weights() . D, less the mean; bins are those of reduce(). Thread: worker.
Coefficients publish_weights(const ExactPlan& plan, const Published& published) noexcept;

}  // namespace bolo::deblur

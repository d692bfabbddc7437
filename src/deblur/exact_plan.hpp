// The paper's problem without approximation, on any settings and any pattern of lost frames.
#pragma once

#include <array>
#include <span>

#include <Eigen/Dense>

#include "src/deblur/grid.hpp"

namespace bolo::deblur {

// --- The LASSO to convergence: minimise 1/2 ||Z D - Y||^2 + lambda ||D||_1, from its Gram matrix, in double precision.

// Frame-level coefficients and one wavelet a frame: 2 N.
inline constexpr int kMaxColumns = 128;

// Variable size, fixed storage: nothing is allocated while solving.
using Gram = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::ColMajor, kMaxColumns, kMaxColumns>;
using Coefficients = Eigen::Matrix<double, Eigen::Dynamic, 1, Eigen::ColMajor, kMaxColumns, 1>;

class Lasso {
 public:
  // Sets Q = Z^T Z. No allocation. Thread: pipeline.
  void set_gram(const Gram& gram) noexcept;

  // h = Z^T Y. Coordinate descent finds the signs, a linear solve on the non-zero coefficients the values; the
  // optimality conditions are then checked to rounding. Returns false if they were not met after all sweeps (the best
  // point is left in `d`). No allocation. Thread: worker.
  bool solve(const Coefficients& h, double lambda, Coefficients& d) const noexcept;

 private:
  void sweep(double lambda, Coefficients& d, Coefficients& gradient) const noexcept;
  void follow_path(const Coefficients& h, double lambda, Coefficients& d) const noexcept;
  bool polish(const Coefficients& h, double lambda, Coefficients& d) const noexcept;

  Gram gram_;
  Gram start_;  // (Q + ridge I)^-1
};

// Columns of V H^T that can be non-zero: min(2^levels, N) of frame level and, unless reduced, one wavelet per frame.
using Columns = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::ColMajor, kMaxSlots, kMaxColumns>;

struct ExactPlan {
  double lambda = 0.0;  // lambda_half, in the values' units, for pixels without one of their own
  int bins = 0;         // frame-level columns
  double repeat = 1.0;  // bins of the full problem that one of them stands for
  WithinFrame within;   // the columns after them, one per frame, if used
  int samples = 0;
  std::array<int, kMaxSlots> slot{};
  std::array<double, kMaxSlots> decay{};  // of the reference up to the sample
  Columns z;                              // one row for each sample after the reference
  Lasso lasso;
};

// lambda_half in the units of the values. No allocation. Thread: pipeline.
void prepare(ExactPlan& plan, const Settings& settings, double lambda_half, const Pattern& pattern) noexcept;

// One pixel's coefficients D: y holds its received samples, oldest first, less `mean`. Thread: worker.
void solve(const ExactPlan& plan, std::span<const double> y, double lambda_half, Coefficients& d) noexcept;

// The published value is publish_weights() . D, less the mean; bins are those of reduce(). Thread: worker.
Coefficients publish_weights(const ExactPlan& plan, const Published& published) noexcept;

}  // namespace bolo::deblur

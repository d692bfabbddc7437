// The LASSO to convergence: minimise 1/2 ||Z D - Y||^2 + lambda ||D||_1, by its Gram matrix, double precision.
#pragma once

#include <Eigen/Dense>

namespace bolo::deblur {

// Frame-level coefficients and one wavelet a frame: 2 N.
inline constexpr int kMaxColumns = 128;

// Sizes vary, storage does not: nothing is allocated while solving.
using Gram = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::ColMajor, kMaxColumns, kMaxColumns>;
using Coefficients = Eigen::Matrix<double, Eigen::Dynamic, 1, Eigen::ColMajor, kMaxColumns, 1>;

class Lasso {
 public:
  // Sets Q = Z^T Z. No allocation. Thread: pipeline.
  void set_gram(const Gram& gram) noexcept;

  // h = Z^T Y. Coordinate descent finds the signs, a linear solve on the non-zero coefficients the values; the
  // optimality conditions are then checked to rounding. Returns false when they were not met after all sweeps (the best
  // point is left in `d`). No allocation. Thread: worker.
  bool solve(const Coefficients& h, double lambda, Coefficients& d) const noexcept;

 private:
  void sweep(double lambda, Coefficients& d, Coefficients& gradient) const noexcept;
  void follow_path(const Coefficients& h, double lambda, Coefficients& d) const noexcept;
  bool polish(const Coefficients& h, double lambda, Coefficients& d) const noexcept;

  Gram gram_;
  Gram start_;  // (Q + ridge I)^-1
};

}  // namespace bolo::deblur

// Linear minimum-mean-square weights of unit sum.
#pragma once

#include <Eigen/Dense>

#include "src/motion/kernels.hpp"

namespace bolo::motion {

// Weights for values with the covariances `scene` (of a scene of variance 1, scaled to `variance`) and `noise`, the
// covariances `truth` with the estimated value, and the coefficients `sums` of the unit sum. Thread: any.
template <typename Matrix, typename Vector>
void best_weights(const Matrix& scene, const Matrix& noise, const Vector& truth, const Vector& sums, double variance,
                  FilterWeights& out) {
  constexpr double kModelError = 1e-6;  // of the scene's variance: interpolation and model errors
  Matrix all = variance * scene + noise;
  all.diagonal().array() += kModelError * variance + 1e-9;
  const Eigen::LDLT<Matrix> factors(all);
  const Vector a = factors.solve(variance * truth);
  const Vector b = factors.solve(sums);
  const Vector w = a + (1.0 - sums.dot(a)) / sums.dot(b) * b;
  for (Eigen::Index i = 0; i < w.size(); ++i) out.w[i] = static_cast<float>(w(i));
  const Vector of_all = all * w;
  const Vector of_noise = noise * w;
  out.w[FilterWeights::kError] = static_cast<float>(variance - 2.0 * variance * w.dot(truth) + w.dot(of_all));
  out.w[FilterWeights::kNoise] = static_cast<float>(w.dot(of_noise));
}

}  // namespace bolo::motion

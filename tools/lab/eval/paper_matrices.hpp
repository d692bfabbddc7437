// The paper's problem as matrices: the plain reference of the solvers.
#pragma once

#include <algorithm>
#include <cmath>
#include <numbers>
#include <span>

#include <Eigen/Dense>

namespace bolo::tools::paper {

// V of Theorem 1 (rows x bins). The input is constant over `bins` equal parts of [t.front(), t.back()]; row j belongs
// to the sample at t[j + 1]: y(t[j+1]) = y(t[0]) exp(-(t[j+1] - t[0]) / tau) + sum_k V(j, k) x_k.
// t in s, strictly rising, at least two; tau in s, > 0. Thread: setup.
inline Eigen::MatrixXd response_matrix(std::span<const double> t, int bins, double tau_s) {
  const double width = (t.back() - t.front()) / bins;
  return Eigen::MatrixXd::NullaryExpr(std::ssize(t) - 1, bins, [=](Eigen::Index row, Eigen::Index k) {
    const double sample = t[static_cast<std::size_t>(row) + 1];
    const double begin = t.front() + static_cast<double>(k) * width;
    const double end = std::min(begin + width, sample);
    // exp(-(sample - end) / tau) - exp(-(sample - begin) / tau), without cancellation for short bins.
    return end <= begin ? 0.0 : -std::exp(-(sample - end) / tau_s) * std::expm1(-(end - begin) / tau_s);
  });
}

// Y_j = y[j+1] - y[0] exp(-(t[j+1] - t[0]) / tau): the right-hand side of V A = Y. Thread: setup.
inline Eigen::VectorXd constraints(std::span<const double> t, std::span<const double> y, double tau_s) {
  return Eigen::VectorXd::NullaryExpr(std::ssize(t) - 1, [=](Eigen::Index j) {
    const auto sample = static_cast<std::size_t>(j) + 1;
    return y[sample] - y[0] * std::exp(-(t[sample] - t[0]) / tau_s);
  });
}

// The orthonormal Haar transform of 2^n values (paper, section IV), rows are basis functions: D = H A, A = H^T D.
// Order: D_0 is the scaling coefficient, then wavelets from coarse to fine: 2^l + k is the k-th of level l, positive on
// the first half of its support and negative on the second. Built level by level: the coarser wavelets stretched to
// double width, then the finest ones. Thread: setup.
inline Eigen::MatrixXd haar_matrix(int bins) {
  constexpr double kHalf = 1.0 / std::numbers::sqrt2;
  Eigen::MatrixXd h = Eigen::MatrixXd::Identity(1, 1);
  while (h.rows() < bins) {
    const Eigen::Index size = h.rows();
    h = Eigen::MatrixXd::NullaryExpr(2 * size, 2 * size, [size, h](Eigen::Index i, Eigen::Index k) {
      if (i < size) return kHalf * h(i, k / 2);
      return k / 2 != i - size ? 0.0 : k % 2 == 0 ? kHalf : -kHalf;
    });
  }
  return h;
}

}  // namespace bolo::tools::paper

// The paper's problem as matrices, as it is written: the plain reference of the solvers.
#pragma once

#include <algorithm>
#include <bit>
#include <cassert>
#include <cmath>
#include <numbers>
#include <span>
#include <utility>

#include <Eigen/Dense>

namespace bolo::tools::paper {

// V of Theorem 1 (rows x bins). The input is constant over `bins` equal parts of [t.front(), t.back()]; row j belongs
// to the sample at t[j + 1]:
//   y(t[j+1]) = y(t[0]) exp(-(t[j+1] - t[0]) / tau) + sum_k V(j, k) x_k.
// t in s, strictly rising, at least two; tau in s, > 0. Thread: setup.
inline Eigen::MatrixXd response_matrix(std::span<const double> t, int bins, double tau_s) {
  assert(t.size() >= 2 && bins >= 1 && tau_s > 0.0);
  const double width = (t.back() - t.front()) / bins;
  Eigen::MatrixXd v = Eigen::MatrixXd::Zero(static_cast<Eigen::Index>(t.size()) - 1, bins);
  for (Eigen::Index row = 0; row < v.rows(); ++row) {
    const double sample = t[static_cast<std::size_t>(row) + 1];
    for (Eigen::Index k = 0; k < bins; ++k) {
      const double begin = t.front() + static_cast<double>(k) * width;
      const double end = std::min(begin + width, sample);
      if (end <= begin) break;
      // exp(-(sample - end) / tau) - exp(-(sample - begin) / tau), without cancellation for short bins.
      v(row, k) = -std::exp(-(sample - end) / tau_s) * std::expm1(-(end - begin) / tau_s);
    }
  }
  return v;
}

// Y_j = y[j+1] - y[0] exp(-(t[j+1] - t[0]) / tau): what V maps the input to. Thread: setup.
inline Eigen::VectorXd constraints(std::span<const double> t, std::span<const double> y, double tau_s) {
  assert(t.size() == y.size() && t.size() >= 2);
  Eigen::VectorXd result(static_cast<Eigen::Index>(t.size()) - 1);
  for (Eigen::Index j = 0; j < result.size(); ++j) {
    const auto sample = static_cast<std::size_t>(j) + 1;
    result(j) = y[sample] - y[0] * std::exp(-(t[sample] - t[0]) / tau_s);
  }
  return result;
}

// The orthonormal Haar transform of 2^n values (paper, section IV: A = H^T D). Order of the coefficients: D_0 is
// the scaling coefficient, then wavelets from coarse to fine: index 2^l + k is the k-th wavelet of level l, positive on
// the first half of its support and negative on the second.
// H (K x K), rows are basis functions: D = H A, A = H^T D. K a power of two. Thread: setup.
// Made one level after the other: the coarser wavelets twice as wide, then the finest ones.
inline Eigen::MatrixXd haar_matrix(int bins) {
  assert(std::has_single_bit(static_cast<unsigned>(bins)));
  constexpr double kHalf = 1.0 / std::numbers::sqrt2;
  Eigen::MatrixXd h = Eigen::MatrixXd::Identity(1, 1);
  while (h.rows() < bins) {
    const Eigen::Index size = h.rows();
    Eigen::MatrixXd next = Eigen::MatrixXd::Zero(2 * size, 2 * size);
    for (Eigen::Index k = 0; k < size; ++k) {
      next.block(0, 2 * k, size, 1) = next.block(0, 2 * k + 1, size, 1) = kHalf * h.col(k);
      next(size + k, 2 * k) = kHalf;
      next(size + k, 2 * k + 1) = -kHalf;
    }
    h = std::move(next);
  }
  return h;
}

}  // namespace bolo::tools::paper

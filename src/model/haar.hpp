// The orthonormal Haar transform of 2^n values (paper, section IV: A = H^T D).
//
// Order of the coefficients: D_0 is the scaling coefficient, then wavelets from coarse to fine: index 2^l + k is the
// k-th wavelet of level l, positive on the first half of its support and negative on the second.
#pragma once

#include <span>

#include <Eigen/Dense>

namespace bolo::model {

// H (K x K), rows are basis functions: D = H A, A = H^T D. K a power of two. Thread: setup.
Eigen::MatrixXd haar_matrix(int bins);

// D = H A in place, K = values.size(), O(K). Thread: any.
void haar_forward(std::span<double> values);
// A = H^T D in place. Thread: any.
void haar_inverse(std::span<double> values);

}  // namespace bolo::model

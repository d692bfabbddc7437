// The microbolometer (paper eq. 7): tau dy/dt + y = x, and its response to an input that is constant over bins.
#pragma once

#include <span>

#include <Eigen/Dense>

namespace bolo::model {

// V of Theorem 1 (rows x bins). The input is constant over `bins` equal parts of [t.front(), t.back()]; row j belongs
// to the sample at t[j + 1]:
//   y(t[j+1]) = y(t[0]) exp(-(t[j+1] - t[0]) / tau) + sum_k V(j, k) x_k.
// t in s, strictly rising, at least two; tau in s, > 0. Thread: setup.
Eigen::MatrixXd response_matrix(std::span<const double> t, int bins, double tau_s);

// Y_j = y[j+1] - y[0] exp(-(t[j+1] - t[0]) / tau): what V maps the input to. Thread: setup.
Eigen::VectorXd constraints(std::span<const double> t, std::span<const double> y, double tau_s);

// The largest l1 weight with which a within-frame Haar column of V H^T is a combination of the frame-level columns
// (N frames of `period_s`). Below 1 no within-frame coefficient can be non-zero, whatever the data and lambda: the
// frame-level problem has exactly the same optimum. Thread: setup.
double fine_column_bound(int frames, double period_s, double tau_s);

// All wavelets inside one frame have collinear columns of V H^T; only those of the level with the longest column can be
// non-zero. 0: the wavelet as wide as the frame (T / tau < 6.66); 1: half as wide, and so on. Thread: setup.
int strongest_wavelet_level(double period_s, double tau_s);

// --- The orthonormal Haar transform of 2^n values (paper, section IV: A = H^T D).  Order of the coefficients: D_0 is
// the scaling coefficient, then wavelets from coarse to fine: index 2^l + k is the k-th wavelet of level l, positive on
// the first half of its support and negative on the second.

// H (K x K), rows are basis functions: D = H A, A = H^T D. K a power of two. Thread: setup.
Eigen::MatrixXd haar_matrix(int bins);

// --- Planck's law over the band of an uncooled camera, 7.5 to 14 um.

// Band radiance of a black body in kelvin-like units: 300 at 300 K, where it grows by 1 for each kelvin. `kelvin` above
// 0. Thread: any.
double band_radiance(double kelvin) noexcept;

// The temperature of that radiance, K, from 100 to 1500 K; radiances beyond are those of the ends. Good to 1e-6 K.
// Thread: any.
double band_temperature(double radiance) noexcept;

}  // namespace bolo::model

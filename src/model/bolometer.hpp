// The microbolometer (paper eq. 7): tau dy/dt + y = x, and the paper's camera.
#pragma once

namespace bolo::model {

inline constexpr double kA655scTau = 0.011;     // s, the paper's measurement
inline constexpr double kA655scPeriod = 0.005;  // s, 640x120 at 200 Hz

// V of Theorem 1 (paper) maps the input of a window's bins to its samples; H is the orthonormal Haar transform, A = H^T
// D. The largest l1 weight with which a within-frame Haar column of V H^T is a combination of the frame-level columns
// (N frames of `period_s`). Below 1 no within-frame coefficient can be non-zero, whatever the data and lambda: the
// frame-level problem has exactly the same optimum. Thread: setup.
double fine_column_bound(int frames, double period_s, double tau_s);

// All wavelets inside one frame have collinear columns of V H^T; only those of the level with the longest column can be
// non-zero. 0: the wavelet as wide as the frame (T / tau < 6.66); 1: half as wide, and so on. Thread: setup.
int strongest_wavelet_level(double period_s, double tau_s);

// --- Planck's law over the band of an uncooled camera, 7.5 to 14 um.

// Band radiance of a black body in kelvin-like units: 300 at 300 K, with slope 1 there. `kelvin` above 0. Thread: any.
double band_radiance(double kelvin) noexcept;

// Temperature of that radiance, K, clamped to 100 to 1500 K. Good to 1e-6 K. Thread: any.
double band_temperature(double radiance) noexcept;

}  // namespace bolo::model

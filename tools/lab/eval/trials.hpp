// Trial of `bolo-lab eval pixel`: one pixel whose input jumps four times in a window, by least squares and by the
// paper's quadratic programme (the paper's Fig. 4).
#pragma once

#include <vector>

namespace bolo::tools {

struct PixelTrial {
  double tau_s = 0.011;
  double period_s = 0.005;
  int frames = 17;
  int levels = 7;      // 2^levels bins
  double kappa = 0.1;  // as in the paper's objective
  double lambda = 0.1;
  double base_k = 300.0;
  std::vector<double> switch_s{0.0135, 0.0310, 0.0465, 0.0630};
  std::vector<double> level_k{315.0, 300.0, 308.0, 300.0};  // after each switch
};

// The exact samples y_0 .. y_N; before the first switch the pixel is in steady state. Thread: any.
std::vector<double> sample_pixel(const PixelTrial& trial);

// Mean input in each bin. Thread: any.
std::vector<double> truth_of(const PixelTrial& trial);

// Bins of the least-norm solution of V A = Y: ordinary least squares with more unknowns than samples.
std::vector<double> least_squares(const PixelTrial& trial, const std::vector<double>& samples);

// Bins that minimise kappa ||V H^T D - Y||^2 + lambda ||D||_1 (paper eq. 11), by coordinate descent to 1e-9 K.
std::vector<double> quadratic_programme(const PixelTrial& trial, const std::vector<double>& samples);

double rmse(const std::vector<double>& a, const std::vector<double>& b);

}  // namespace bolo::tools

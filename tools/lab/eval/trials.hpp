// Trials of `bolo-lab eval pulses` and `eval pixel`: a simulated chopper before a simulated camera, in memory; and one
// pixel whose input steps four times within a window, estimated by least squares and by the paper's quadratic programme
// (the paper's Fig. 4).
#pragma once

#include <atomic>

#include "src/diagnose/calibrate.hpp"
#include "tools/lab/common.hpp"

namespace bolo::tools {

// Camera and bench of one trial. The fit gets only frames and their times.
struct PulseTrial {
  std::string name = "nominal";
  double tau_s = 0.011;
  double noise_k = 0.03;
  double sweep_s = 0.0;     // time of the blade's edge across the field
  double softness_s = 0.0;  // of the blade's edge
  double tau_spread = 0.0;  // rms, as a fraction
  double level_error_k = 0.0;
  bool part_of_field = false;  // pulses reach only a part of the pixels
  double cold_k = 295.0;
  std::vector<double> levels_k{305.0, 320.0};
  std::vector<double> pulses_ms{12.0, 30.0, 60.0, 120.0, 300.0};
  double gap_ms = 83.7;
  int width = 64;
  int height = 48;
  std::size_t frames = 400;
  double rate_hz = 200.0;
  std::uint64_t seed = 1;  // of noise, pattern and the chopper's start
};

// Simulates the trial. Thread: setup.
Result<diagnose::FrameSeries> simulate_pulses(const PulseTrial& trial);

// The trials of `bolo-lab eval pulses`. Thread: any.
std::vector<PulseTrial> pulse_trials();

// Scores seeds 1 .. `seeds` of one trial; fewer when `stop` is set. Errors are relative; sums are means. Thread: setup.
Result<Json> score_pulses(const PulseTrial& trial, int seeds, const std::atomic<bool>& stop);

struct PixelTrial {
  double tau_s = 0.011;
  double period_s = 0.005;
  int frames = 17;
  int levels = 7;      // 2^levels bins
  double kappa = 0.1;  // of the paper's objective
  double lambda = 0.1;
  double base_k = 300.0;
  std::vector<double> switch_s{0.0135, 0.0310, 0.0465, 0.0630};
  std::vector<double> level_k{315.0, 300.0, 308.0, 300.0};  // after each switch
};

// The samples y_0 .. y_N, exact; before the first switch the pixel is in steady state. Thread: any.
std::vector<double> sample_pixel(const PixelTrial& trial);

// The input's mean over each bin. Thread: any.
std::vector<double> truth_of(const PixelTrial& trial);

// Bins of the minimum-norm solution of V A = Y: ordinary least squares, underdetermined.
std::vector<double> least_squares(const PixelTrial& trial, const std::vector<double>& samples);

// Bins that minimise kappa ||V H^T D - Y||^2 + lambda ||D||_1 (paper eq. 11), by coordinate descent to 1e-9 K.
std::vector<double> quadratic_programme(const PixelTrial& trial, const std::vector<double>& samples);

double rmse(const std::vector<double>& a, const std::vector<double>& b);

// Scores `draws` draws of white noise: errors and, averaged over the draws, how far the largest and smallest bins
// exceed the input's range. No noise: one draw.
Json score_pixel(const PixelTrial& trial, double noise_k, int draws, std::uint64_t seed);

}  // namespace bolo::tools

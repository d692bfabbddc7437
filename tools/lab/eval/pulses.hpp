// A simulated chopper before a simulated camera, in memory, for `bolo-lab eval pulses` and its tests.
#pragma once

#include <atomic>
#include <cstdint>
#include <string>
#include <vector>

#include "src/core/result.hpp"
#include "src/diagnose/calibrate.hpp"

namespace bolo::tools {

// The camera and the bench of one trial. The fit gets frames and their times, nothing else.
struct PulseTrial {
  std::string name = "nominal";
  double tau_s = 0.011;
  double noise_k = 0.03;
  double sweep_s = 0.0;     // the blade's way over the field
  double softness_s = 0.0;  // its edge
  double tau_spread = 0.0;  // rms, as a fraction
  double level_error_k = 0.0;
  bool part_of_field = false;  // pulses reach a part of the pixels only
  double cold_k = 295.0;
  std::vector<double> levels_k{305.0, 320.0};
  std::vector<double> pulses_ms{12.0, 30.0, 60.0, 120.0, 300.0};
  double gap_ms = 83.7;
  int width = 64;
  int height = 48;
  std::size_t frames = 400;
  double rate_hz = 200.0;
  std::uint64_t seed = 1;  // of noise, pattern, and when the chopper starts
};

// Simulates the trial. Thread: setup.
Result<diagnose::FrameSeries> simulate_pulses(const PulseTrial& trial);

// The trials that `bolo-lab eval pulses` goes through. Thread: any.
std::vector<PulseTrial> pulse_trials();

// What many seeds of one trial came to.
struct PulseScore {
  std::string name;
  int trials = 0;
  int failed = 0;            // no fit
  int inside = 0;            // of the fits' own 95 % intervals
  double mean_error = 0.0;   // relative
  double worst_error = 0.0;  // largest |relative error|
  double half_width = 0.0;   // mean half width of the interval, relative
  double gap = 0.0;          // mean
  double rmse_k = 0.0;       // mean
  double sweep_ms = 0.0;     // mean
  double spread = 0.0;       // mean
};

// Seeds 1 .. `seeds`; fewer when `stop` is set. Thread: setup.
Result<PulseScore> score_pulses(const PulseTrial& trial, int seeds, const std::atomic<bool>& stop);

}  // namespace bolo::tools

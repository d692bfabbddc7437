// A simulated chopper before a simulated camera, in memory, for `bolo-lab eval pulses` and its tests.
#pragma once

#include <atomic>

#include "src/diagnose/calibrate.hpp"
#include "tools/lab/common.hpp"

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

// What seeds 1 .. `seeds` of one trial came to; fewer when `stop` is set. Errors are relative; sums are means.
// Thread: setup.
Result<Json> score_pulses(const PulseTrial& trial, int seeds, const std::atomic<bool>& stop);

}  // namespace bolo::tools

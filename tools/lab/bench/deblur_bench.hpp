// Time and accuracy of the ways to deblur one 640x120 frame, all in one run on one input.
#pragma once

#include <string>
#include <vector>

#include "src/core/result.hpp"
#include "src/deblur/settings.hpp"

namespace bolo::tools {

struct BenchOptions {
  std::string solver = "admm";
  std::string isa;       // "": the best
  int threads = 1;       // of the main figures
  double lambda = -1.0;  // kappa 0.1; below 0: the default
  double seconds = 5.0;  // of measuring; every variant is measured at least three times
};

// One way to deblur a frame. Times are of a whole 640x120 frame; those of slow variants are scaled from fewer pixels.
struct Measured {
  std::string solver;  // as --solver
  std::string isa;
  int threads = 1;
  bool profile = false;  // with maps of gain, offset, time constant and dead pixels, and a row delay
  int lost = 0;          // frames before the newest that are missing
  int iterations = 0;
  double lambda_half_k = 0.0;
  std::size_t pixels = 0;  // measured
  int repeats = 0;
  double ms_per_frame = 0.0;  // the fastest repeat
  double median_ms_per_frame = 0.0;
  double ns_per_pixel = 0.0;
  double rms_error_k = 0.0;  // against `exact` at the same lambda
  double max_error_k = 0.0;
  double realtime_factor = 0.0;  // frame period / ms_per_frame
  double scaling = 1.0;          // time of one thread / (this time), where that was measured
  double of_plain = 1.0;         // frames a second with the profile, or lost frames, / those without
};

struct BenchReport {
  Measured main;
  std::vector<Measured> variants;
  int processors = 1;
};

// kBadInput for a solver, instruction set or number of threads that there is not. Changes force_isa() while it runs.
// Thread: setup.
Result<BenchReport> bench_deblur(const BenchOptions& options);

}  // namespace bolo::tools

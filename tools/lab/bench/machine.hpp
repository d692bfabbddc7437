// What the machine can do at most, for comparison.
#pragma once

namespace bolo::tools {

struct MachinePeaks {
  double read_gb_per_s = 0.0;  // reading memory that no cache holds, one thread
  double fma_gflop_per_s =
      0.0;  // single precision multiply-adds, two operations each, one thread, best instruction set
};

// Takes about a fifth of a second. Thread: setup.
MachinePeaks measure_peaks();

}  // namespace bolo::tools

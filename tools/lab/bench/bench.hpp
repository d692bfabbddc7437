// Measurements of `bolo-lab bench`, as printed with --json.
#pragma once

#include "tools/lab/common.hpp"

namespace bolo::tools {

struct BenchOptions {
  std::string solver = "admm";
  std::string isa;       // "": the best
  int threads = 1;       // of the main figures
  double lambda = -1.0;  // kappa 0.1; below 0: the default
  double seconds = 5.0;  // of measuring; every variant is measured at least three times
};

// The main figures; all others, each with the same keys, in "variants". kBadInput for a solver, instruction set or
// number of threads that there is not. Changes force_isa() while it runs. Thread: setup.
Result<Json> bench_deblur(const BenchOptions& options);

// For each number of readers one of "cases": how many of them are frozen and killed in the middle of a phase, and slow
// (a tenth of the rate); the call that publishes a frame (publish_us_p50, _p99), from when a frame was due to when it
// was published (due_us_p99), ratios to the writer without readers, and the share of the frames that readers to which
// nothing was done copied whole and in time (read_fraction). `priority`: SCHED_FIFO, of the writer; 0: the default
// scheduler. Every number of readers is measured at least once. It forks: the process has one thread. Thread: setup.
Result<Json> bench_readers(double seconds, int priority);

}  // namespace bolo::tools

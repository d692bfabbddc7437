// Measurements of `bolo-lab bench`, as printed with --json.
#pragma once

#include "tools/lab/common.hpp"

namespace bolo::tools {

struct BenchOptions {
  std::string solver = "admm";
  std::string isa;       // "": the fastest
  int threads = 1;       // of the main variant
  double lambda = -1.0;  // for kappa 0.1; below 0: the default
  double seconds = 5.0;  // of measurement; every variant is measured at least three times
};

// The main variant; all others are in "variants" with the same keys. kBadInput for an unknown solver, instruction set
// or number of threads. Changes force_isa() while it runs. Thread: setup.
Result<Json> bench_deblur(const BenchOptions& options);

// One of "cases" for each number of readers: how many are frozen, killed in the middle of a phase, and slow (a tenth of
// the rate); duration of the publishing call (publish_us_p50, _p99), delay from a frame's due time to its publication
// (due_us_p99), ratios to the writer without readers, and the share of frames that undisturbed readers copied whole and
// in time (read_fraction). `priority`: the writer's SCHED_FIFO priority; 0: default scheduler. Every number of readers
// is measured at least once. It forks: the process must have one thread. Thread: setup.
Result<Json> bench_readers(double seconds, int priority);

}  // namespace bolo::tools

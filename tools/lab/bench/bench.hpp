// Measurement of `bolo-lab bench readers`, as printed by --json.
#pragma once

#include "tools/lab/common.hpp"

namespace bolo::tools {

// For each number of readers an entry in "cases": how many of them are frozen and killed in the middle of a phase, and
// how many are slow (a tenth of the rate); duration of the call that publishes a frame (publish_us_p50, _p99), delay
// from due time to publication (due_us_p99), their ratios to the writer without readers, and the share of frames that
// undisturbed readers copied whole and in time (read_fraction). `priority`: of the writer by SCHED_FIFO; 0: default
// scheduler. Measures every number of readers at least once. Forks: the process must be single-threaded. Thread: setup.
Result<Json> bench_readers(double seconds, int priority);

}  // namespace bolo::tools

// What readers of shared memory cost the writer: its rate and latency with 0, 1, 4 and 16 of them, each a process that
// reads through libbolo-client.
#pragma once

#include <cstdint>
#include <vector>

#include "src/core/result.hpp"

namespace bolo::tools {

struct ReadersOptions {
  double seconds = 40.0;  // of measuring; every number of readers is measured at least once
  int priority = 10;      // SCHED_FIFO, of the writer; 0: the default scheduler
};

// Of one number of readers. Medians of the rounds; ratios are taken within a round, to its phase without readers.
struct ReadersMeasured {
  int readers = 0;
  int frozen = 0;  // of them: stopped in the middle of a phase
  int killed = 0;  // killed in the middle of a phase
  int slow = 0;    // a tenth of the rate
  double rate_hz = 0.0;
  double publish_us_p50 = 0.0;  // the call that publishes a frame
  double publish_us_p99 = 0.0;
  double due_us_p99 = 0.0;  // from when the frame was due to when it was published
  double rate_ratio = 1.0;
  double publish_p99_ratio = 1.0;
  double due_p99_ratio = 1.0;
  double read_fraction = 0.0;  // of the frames, by the readers that nothing was done to: copied whole and in time
};

struct ReadersReport {
  std::vector<ReadersMeasured> cases;
  int rounds = 0;
  int frames_per_phase = 0;
  int processors = 1;
  bool realtime = false;  // whether the writer got its priority
};

// It forks: the process has one thread. Thread: setup.
Result<ReadersReport> bench_readers(const ReadersOptions& options);

}  // namespace bolo::tools

// Counters of the pipeline, readable while it runs.
#pragma once

#include <algorithm>
#include <array>
#include <cstdint>

#include "src/pipeline/inlet.hpp"
#include "src/pipeline/quality_level.hpp"
#include "src/pipeline/source_status.hpp"
#include "src/rt/counters.hpp"

namespace bolo::pipeline {

// Latency of a frame by stage. Without look-ahead arrival, queue and deblur of a frame add up to its total latency;
// with look-ahead it also waits for the frames after it.
struct StageLatencies {
  rt::LatencyHistogram arrival;  // first byte received -> whole and in the frame queue
  rt::LatencyHistogram queue;    // in the queue -> taken by the pipeline thread
  rt::LatencyHistogram deblur;   // taken, or the frame before it published -> sharp
  rt::LatencyHistogram publish;  // sharp -> every sink has its copy
};

// Written by the pipeline thread, read by any.
struct PipelineStats {
  explicit PipelineStats(const FrameInlet& i, const SourceStatus* s = nullptr) : inlet(i), source(s) {}

  // Frames that were received and not yet taken. Thread: any.
  std::uint64_t waiting() const noexcept {
    const std::uint64_t gone = taken.value();  // before what it is taken from
    const std::uint64_t come = inlet.received();
    return come - std::min(gone, come);  // a frame is counted only after it was put where it may be taken
  }

  const FrameInlet& inlet;     // received(), losses()
  const SourceStatus* source;  // of a camera; null for a source that is not monitored
  rt::Counter taken;           // frames taken out of the queue
  rt::Counter published;       // frames handed to the sinks
  rt::Counter restarts;        // windows emptied: NUC, reconnect, a jump in time
  rt::Counter warm_up;         // published without a full window behind them
  rt::Counter gap_frames;      // published with a lost frame in their window
  std::array<rt::Counter, kQualityLevels>
      by_effort;                   // of the frames with a full window; their sum is published - warm_up
  rt::Gauge<QualityLevel> effort;  // of the last one
  rt::Counter deblur_ns;           // time spent solving, summed over frames
  rt::Counter repeats;             // frames that repeated the one before and were dropped; among the missing, too
  rt::LatencyHistogram latency;    // first byte received -> publish_ns, right before the sinks get it
  StageLatencies stages;
  // CLOCK_MONOTONIC, when the pipeline thread last polled for a frame, which it does ten times a second at least;
  // 0: it does not run yet.
  rt::Gauge<std::int64_t> polled_ns;
};

}  // namespace bolo::pipeline

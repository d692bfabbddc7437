// What the pipeline knows of itself, readable while it runs.
#pragma once

#include "bolo/pipeline/inlet.hpp"
#include "bolo/pipeline/source_status.hpp"
#include "bolo/rt/counters.hpp"

namespace bolo::pipeline {

// Written by the pipeline thread, read by any.
struct PipelineStats {
  explicit PipelineStats(const FrameInlet& i, const SourceStatus* s = nullptr) : inlet(i), source(s) {}

  const FrameInlet& inlet;       // received(), losses()
  const SourceStatus* source;    // of a camera; null for a source that is not watched
  rt::Counter published;         // frames handed to the sinks
  rt::Counter restarts;          // windows emptied: NUC, reconnect, a jump in time
  rt::Counter warm_up;           // published without a full window behind them
  rt::Counter gap_frames;        // published with a lost frame in their window
  rt::Counter deblur_ns;         // time spent solving, summed over frames
  rt::LatencyHistogram latency;  // first byte received -> publish_ns, right before the sinks get it
};

}  // namespace bolo::pipeline

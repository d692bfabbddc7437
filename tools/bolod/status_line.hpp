// One line on how the daemon does, for `systemctl status`.
#pragma once

#include <array>
#include <cstdint>
#include <string>

#include "src/pipeline/stats.hpp"
#include "tools/bolod/health.hpp"

namespace bolo::daemon {

// Rate and latency of the time since the last line, losses since the start. Thread: one at a time.
class StatusLine {
 public:
  explicit StatusLine(std::int64_t start_ns) : before_ns_(start_ns) {}

  // "200.0 frames/s, latency p50 0.61 ms, p99 0.92 ms; lost: none", with the camera's state before it when it does not
  // stream. now_ns: CLOCK_MONOTONIC.
  std::string next(const pipeline::PipelineStats& stats, std::int64_t now_ns);

 private:
  using Counts = std::array<std::uint64_t, rt::LatencyHistogram::kBuckets>;
  std::int64_t before_ns_;
  std::uint64_t published_ = 0;
  Counts latency_{};
};

}  // namespace bolo::daemon

// Monitors the running daemon from the main thread, for the log and the service manager.
#pragma once

#include <array>
#include <cstdint>
#include <string>
#include <vector>

#include <spdlog/logger.h>

#include "src/pipeline/pipeline.hpp"
#include "src/pipeline/stats.hpp"
#include "src/rt/counters.hpp"
#include "tools/bolod/health.hpp"
#include "tools/bolod/service_manager.hpp"

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

// Thread: one at a time, but for flows().
class Supervisor {
 public:
  // All outlive it. stall_ms: of the source, as it was asked for.
  struct Subject {
    spdlog::logger& log;
    pipeline::Pipeline& pipeline;
    int stall_ms = 0;
  };
  explicit Supervisor(const Subject& subject);

  // At some ten calls a second: sends readiness, status and watchdog to the service manager, and events to the log.
  void poll();
  // Logs the last events and the totals, after the pipeline has ended.
  void log_end();

  // The watchdog gets signs of life. Thread: any.
  const rt::Gauge<bool>& flows() const noexcept { return flows_; }

 private:
  Supervisor(const Subject& subject, double period_s, std::int64_t now_ns);

  void log(const std::vector<pipeline::Notice>& notices) const;
  void notify_status(std::int64_t now_ns);
  void feed_watchdog(std::int64_t now_ns);
  Signs signs(std::int64_t now_ns) const;
  const pipeline::PipelineStats& stats() const noexcept { return subject_.pipeline.stats(); }

  const Subject subject_;
  Health health_;
  FlowWatch flow_;
  StatusLine line_;
  service::Watchdog watchdog_;
  std::int64_t next_line_ns_ = 0;
  bool ready_ = false;   // the service manager was told
  std::string trouble_;  // reason for which the watchdog was not fed at the last poll
  rt::Gauge<bool> flows_{true};
};

}  // namespace bolo::daemon

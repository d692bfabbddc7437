// Monitors the running daemon from the main thread, for the log and the service manager.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include <spdlog/logger.h>

#include "src/pipeline/pipeline.hpp"
#include "src/rt/counters.hpp"
#include "tools/bolod/health.hpp"
#include "tools/bolod/service_manager.hpp"
#include "tools/bolod/status_line.hpp"

namespace bolo::daemon {

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

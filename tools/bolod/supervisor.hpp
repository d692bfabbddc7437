// What the main thread does while frames flow: looks how the daemon is, and tells log and service manager.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include <spdlog/logger.h>

#include "src/pipeline/pipeline.hpp"
#include "src/rt/counters.hpp"
#include "tools/bolod/flow_watch.hpp"
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

  // At some ten calls a second: says that the daemon is ready, how it does, that it lives, and what happened.
  void look();
  // What happened since the last look, and how it all went. When nothing runs any more.
  void tell_end();

  // The watchdog gets signs of life. Thread: any.
  const rt::Gauge<bool>& flows() const noexcept { return flows_; }

 private:
  Supervisor(const Subject& subject, double period_s, std::int64_t now_ns);

  void tell(const std::vector<pipeline::Notice>& notices) const;
  void tell_status(std::int64_t now_ns);
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
  std::string trouble_;  // what kept the watchdog from being fed at the last look
  rt::Gauge<bool> flows_{true};
};

}  // namespace bolo::daemon

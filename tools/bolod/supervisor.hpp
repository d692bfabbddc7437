// Health of a running daemon, polled by the main thread: notices for the log (changes of state, not single frames), and
// the check for the service manager that frames flow.
#pragma once

#include <array>
#include <cstdint>
#include <string>
#include <vector>

#include <spdlog/logger.h>

#include "src/core/loss.hpp"
#include "src/pipeline/notices.hpp"
#include "src/pipeline/pipeline.hpp"
#include "src/pipeline/stats.hpp"
#include "src/rt/counters.hpp"
#include "tools/bolod/service_manager.hpp"

namespace bolo::daemon {

using LossCounts = std::array<std::uint64_t, kLossCauses>;

// Thread: any.
LossCounts loss_counts(const pipeline::PipelineStats& stats);

using QualityCounts = std::array<std::uint64_t, pipeline::kQualityLevels>;

// Thread: any.
QualityCounts quality_counts(const pipeline::PipelineStats& stats);

struct Snapshot {
  std::int64_t now_ns = 0;     // CLOCK_MONOTONIC
  std::uint64_t received = 0;  // frames
  LossCounts losses{};
  bool watched = false;  // the source itself reports when frames stop and resume
  QualityCounts by_effort{};
};

// Turns a series of snapshots into notices. Thread: one at a time.
class Health {
 public:
  // `frame_period_s` determines how long without a frame is too long.
  explicit Health(double frame_period_s, std::int64_t start_ns);

  // Call a few times per second. Lost frames and overload are logged at most every 10 s, so as not to flood the log.
  std::vector<pipeline::Notice> poll(const Snapshot& now);

 private:
  void check_flow(const Snapshot& now, std::vector<pipeline::Notice>& notices);
  void check_losses(const Snapshot& now, std::vector<pipeline::Notice>& notices);
  void check_quality(const Snapshot& now, std::vector<pipeline::Notice>& notices);

  enum class Flow { kWaiting, kFlowing, kStopped };
  std::int64_t patience_ns_;
  std::int64_t last_frame_ns_;
  std::int64_t last_loss_notice_ns_;
  Flow flow_ = Flow::kWaiting;
  std::uint64_t received_ = 0;
  LossCounts logged_{};  // losses already in the log
  QualityCounts logged_efforts_{};
  std::int64_t last_effort_notice_ns_;
  bool overloaded_ = false;
};

// State of pipeline and source at one moment. Times: CLOCK_MONOTONIC.
struct Signs {
  std::int64_t now_ns = 0;
  std::int64_t polled_ns = 0;   // last poll of the pipeline thread for a frame; 0: not running yet
  std::uint64_t received = 0;   // frames that reached the queue
  std::uint64_t handled = 0;    // frames published, or dropped as repeats
  bool watched = false;         // the source monitors a camera and reports its state:
  bool streams = false;         // the camera streams
  std::int64_t watched_ns = 0;  // last check of the camera
};

// Healthy: arriving frames are published, or none arrives and a monitored source reports why (its camera stalls, is
// lost or does a NUC). For an unmonitored source, no frame is due when none arrives. Thread: one at a time.
class FlowWatch {
 public:
  // stall_ns: silence after which a monitored source reports a stall. lookahead: frames before the first publication.
  FlowWatch(double frame_period_s, int lookahead, std::int64_t stall_ns, std::int64_t start_ns);

  // Returns the fault; empty when healthy. Call several times per second.
  std::string check(const Signs& signs);

 private:
  // A number that should rise, and the time of its last change.
  struct Progress {
    std::uint64_t value = 0;
    std::int64_t since_ns = 0;
    void update(std::uint64_t now_value, std::int64_t now_ns) {
      if (now_value == value) return;
      value = now_value;
      since_ns = now_ns;
    }
  };
  const std::int64_t patience_ns_;  // from a frame's arrival to its publication
  const std::int64_t stall_ns_;
  Progress received_;
  Progress handled_;
};

// --- Monitors the running daemon from the main thread, for the log and the service manager.

// Rate and latency since the last line, losses since the start. Thread: one at a time.
class StatusLine {
 public:
  explicit StatusLine(std::int64_t start_ns) : before_ns_(start_ns) {}

  // "200.0 frames/s, latency p50 0.61 ms, p99 0.92 ms; lost: none", preceded by the camera's state if it does not
  // stream. now_ns: CLOCK_MONOTONIC.
  std::string next(const pipeline::PipelineStats& stats, std::int64_t now_ns);

 private:
  using Counts = std::array<std::uint64_t, rt::LatencyHistogram::kBuckets>;
  std::int64_t before_ns_;
  std::uint64_t published_ = 0;
  Counts latency_{};
};

// Thread: one at a time, except flows().
class Supervisor {
 public:
  // All must outlive it. stall_ms: configured value of the source.
  struct Subject {
    spdlog::logger& log;
    pipeline::Pipeline& pipeline;
    int stall_ms = 0;
  };
  explicit Supervisor(const Subject& subject);

  // Call about ten times per second. Notifies the service manager (readiness, status, watchdog); logs events.
  void poll();
  // Logs the last events and the totals, after the pipeline has ended.
  void log_end();

  // True while the watchdog is fed. Thread: any.
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
  bool ready_ = false;   // the service manager was notified
  std::string trouble_;  // reason why the watchdog was not fed at the last poll
  rt::Gauge<bool> flows_{true};
};

}  // namespace bolo::daemon

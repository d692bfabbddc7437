// Keeps a camera streaming into an inlet from start to stop: watches it, and opens it again when it is lost.
#pragma once

#include <atomic>
#include <condition_variable>
#include <cstdint>
#include <future>
#include <memory>
#include <mutex>
#include <string>
#include <thread>
#include <vector>

#include "bolo/core/result.hpp"
#include "bolo/rt/counters.hpp"
#include "drivers/genicam/intake.hpp"
#include "drivers/genicam/session.hpp"

namespace bolo::genicam {

// The watching thread shares ownership: while a dead camera holds it up it may outlive stop(), but then touches neither
// the inlet nor whoever called stop(). The mutex is never taken by the acquire thread.
class Keeper : public std::enable_shared_from_this<Keeper> {
 public:
  // The inlet outlives stop(). Thread: setup.
  Keeper(const CameraOptions& options, pipeline::SourceInfo info, pipeline::FrameInlet& inlet);

  // Starts the stream and the watch. Thread: setup.
  Status start(std::unique_ptr<Session> session);
  // No frame is handed in after it returns. Waits for the connection's end at most kStopLimit. Thread: setup.
  void stop() noexcept;

  // Thread: any.
  SourceState state() const noexcept { return state_.load(std::memory_order_relaxed); }
  std::uint64_t reconnects() const noexcept { return reconnects_.value(); }
  TransportStats transport() const;
  std::vector<std::string> warnings() const;
  const rt::LatencyHistogram& latency() const noexcept { return intake_.latency(); }

 private:
  void watch();
  bool pause(std::chrono::milliseconds time);
  SourceState judge() const;
  void reopen();
  bool try_reopen();
  Status adopt(std::unique_ptr<Session> session);
  void drop_session();
  void note(std::vector<std::string> texts);

  const CameraOptions options_;
  const pipeline::SourceInfo info_;
  Intake intake_;
  std::atomic<SourceState> state_{SourceState::kIdle};  // stands alone: relaxed
  std::atomic<bool> stop_{false};                       // written under the mutex; read without it to give up early
  rt::Counter reconnects_;
  std::int64_t since_ns_ = 0;  // the present session's start; watching thread only once that runs
  mutable std::mutex mutex_;   // guards what follows
  std::condition_variable wake_;
  std::unique_ptr<Session> session_;
  TransportStats past_;  // of sessions that have ended
  std::vector<std::string> warnings_;
  std::thread watcher_;  // setup thread only
  std::future<void> watched_;
};

}  // namespace bolo::genicam

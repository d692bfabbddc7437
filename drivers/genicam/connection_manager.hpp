// Keeps a camera streaming from start to stop: monitors the connection, reopens a lost camera and triggers NUCs.
#pragma once

#include <atomic>
#include <chrono>
#include <condition_variable>
#include <cstdint>
#include <future>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <string_view>
#include <system_error>
#include <thread>
#include <utility>
#include <vector>

#include "drivers/genicam/frame_receiver.hpp"
#include "drivers/genicam/session.hpp"
#include "src/core/result.hpp"
#include "src/pipeline/notices.hpp"
#include "src/pipeline/source.hpp"

namespace bolo::genicam {

// Closes connections on threads of their own: to close that of a dead camera takes seconds.
// A thread that is still blocked when this is destroyed owns all that it touches. Thread: one at a time.
class SessionCloser {
 public:
  // The session is shut already: it delivers no frames.
  void close(std::unique_ptr<Session> session) {
    {
      const std::lock_guard lock(state_->mutex);
      ++state_->running;
    }
    const auto end = [state = state_](std::unique_ptr<Session> ending) {
      ending.reset();
      const std::lock_guard lock(state->mutex);
      --state->running;
      state->ended.notify_all();
    };
    const auto shared = std::make_shared<std::unique_ptr<Session>>(std::move(session));
    try {
      std::thread([end, shared] { end(std::move(*shared)); }).detach();
    } catch (const std::system_error&) {  // the system has no thread to give
      end(std::move(*shared));
    }
  }

  // Waits for all of them until `deadline`.
  void wait_until(std::chrono::steady_clock::time_point deadline) {
    std::unique_lock lock(state_->mutex);
    state_->ended.wait_until(lock, deadline, [this] { return state_->running == 0; });
  }

 private:
  struct State {
    std::mutex mutex;
    std::condition_variable ended;
    int running = 0;
  };
  std::shared_ptr<State> state_ = std::make_shared<State>();
};

// The monitoring thread shares ownership: while a dead camera blocks it, it may outlive stop(), but then touches
// neither the inlet nor the caller of stop(). The mutex is never taken by the acquire thread.
class ConnectionManager : public std::enable_shared_from_this<ConnectionManager> {
 public:
  explicit ConnectionManager(CameraOptions options) : options_(std::move(options)), schedule_(options_.nuc) {}

  // As GenicamSource::open(). Thread: setup.
  Result<pipeline::SourceInfo> open();
  // Starts the stream and the monitoring thread. The inlet outlives stop(). Thread: setup, once.
  Status start(pipeline::FrameInlet& inlet);
  // No frame is handed in after it returns. Waits for the connection's end at most kStopLimit. Thread: setup.
  void stop() noexcept;

  // Thread: any.
  const pipeline::SourceStatus& status() const noexcept { return *status_; }
  std::vector<std::string> warnings() const;
  std::vector<pipeline::Notice> take_notices() { return notices_.take(); }
  Status trigger_nuc();
  void set_nuc(const NucOptions& nuc);

 private:
  void run();
  bool sleep(std::chrono::milliseconds time);
  void poll();
  void set_state(SourceState state);
  void note_flow(std::int64_t frame_ns);
  void note_stall(std::int64_t quiet_ns);
  void note_loss(pipeline::LostCause cause, std::int64_t frame_ns);
  std::optional<pipeline::LostCause> find_fault(std::int64_t quiet_ns);
  void reopen(pipeline::LostCause cause);
  bool try_reopen(bool everywhere);
  Status adopt(std::unique_ptr<Session> session);
  std::unique_ptr<Session> take_session();
  void check_scene();
  void check_ptp();
  void serve_requests();
  void apply_nuc_options();
  Status run_nuc(const std::string& why);
  void report(bool warning, std::string text, std::string_view event = {}) {
    notices_.report(warning, std::move(text), event);
  }

  CameraOptions options_;  // the address follows the camera
  pipeline::SourceInfo info_;
  pipeline::WatchLimits limits_{};
  // Sessions that are still being closed share it.
  const std::shared_ptr<pipeline::SourceStatus> status_ = std::make_shared<pipeline::SourceStatus>();
  std::unique_ptr<Session> opened_;        // from open() to start()
  std::optional<FrameReceiver> receiver_;  // from start() on
  pipeline::Notices notices_;
  std::atomic<bool> stop_{false};  // written under the mutex; read without it to give up early

  // The monitoring thread's own, once that runs.
  std::int64_t since_ns_ = 0;  // the present session's start
  std::int64_t next_probe_ns_ = 0;
  std::int64_t outage_from_ns_ = 0;  // the last frame before the camera was lost
  pipeline::LostCause cause_ = pipeline::LostCause::kStalled;
  std::int64_t nuc_until_ns_ = 0;
  int ticks_without_control_ = 0;
  int judged_median_ = -1;
  NucSchedule schedule_;
  std::int64_t next_temperature_ns_ = 0;
  std::string ptp_status_;  // as last reported
  SessionCloser closer_;    // stop() waits for it when the monitoring thread has ended

  mutable std::mutex mutex_;  // guards what follows
  std::condition_variable wake_;
  std::unique_ptr<Session> session_;  // replaced by the monitoring thread only, which therefore reads it without
  std::vector<std::string> warnings_;
  std::condition_variable nuc_done_;
  std::uint64_t nucs_asked_ = 0;
  std::uint64_t nucs_served_ = 0;
  std::optional<NucOptions> new_nuc_;
  Status nuc_result_;   // of the last one that was asked for
  std::thread thread_;  // setup thread only
  std::future<void> ended_;
};

}  // namespace bolo::genicam

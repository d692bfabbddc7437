// One connection to the camera, from opening to closing.
#pragma once

#include <atomic>
#include <chrono>
#include <future>
#include <memory>
#include <string>
#include <thread>
#include <vector>

#include "drivers/genicam/connection.hpp"
#include "drivers/genicam/frame_receiver.hpp"
#include "drivers/genicam/gvsp_receiver.hpp"
#include "drivers/genicam/settings.hpp"
#include "src/core/result.hpp"

namespace bolo::genicam {

// --- Lock-free revocation: one thread uses an object that another may take away.

// The acquire thread brackets its work with enter() and leave(). After shut() it is not inside and never will be again.
// The race, step by step:
//
//   acquire                              setup
//   E1 inside_ = true   (seq_cst)        S1 open_ = false       (seq_cst)
//   E2 open_ ?          (seq_cst)        S2 wait until !inside_ (seq_cst)
//   L1 inside_ = false  (release)
//
// In the total order of seq_cst operations, either E1 precedes S2, and S2 waits for L1; or S1 precedes E2, and the
// acquire thread turns back. L1 -> S2 publishes everything done inside to the thread in shut().
class Gate {
 public:
  // Thread: setup.
  void open() noexcept { open_.store(true, std::memory_order_seq_cst); }  // partner: E2

  // False when the gate is shut; otherwise leave() must follow. Thread: acquire.
  bool enter() noexcept {
    inside_.store(true, std::memory_order_seq_cst);          // E1, partner: S2
    if (open_.load(std::memory_order_seq_cst)) return true;  // E2, partner: S1 and open()
    leave();
    return false;
  }
  void leave() noexcept { inside_.store(false, std::memory_order_release); }  // L1, partner: S2

  // Waits for the acquire thread to leave, within one frame's work. Idempotent. Thread: setup.
  void shut() noexcept {
    open_.store(false, std::memory_order_seq_cst);     // S1, partner: E2
    while (inside_.load(std::memory_order_seq_cst)) {  // S2, partners: E1 and L1
      std::this_thread::sleep_for(std::chrono::microseconds(50));
    }
  }

 private:
  std::atomic<bool> open_{false};
  std::atomic<bool> inside_{false};
};

class AravisStream;

class Session {
 public:
  // Connects and configures; retries for about 8 s when the camera drops the connection after a windowing change,
  // unless stop_requested. search: see connect(). Thread: setup.
  static Result<std::unique_ptr<Session>> open(const CameraOptions& options, bool search,
                                               const std::atomic<bool>& stop_requested,
                                               std::vector<std::string>& warnings);

  // Waits for the camera's answers: several seconds when it is dead.
  ~Session();

  const pipeline::SourceInfo& info() const { return negotiated_.info; }
  const Negotiated& negotiated() const { return negotiated_; }
  // IP address of a GigE Vision camera; empty for others.
  const std::string& address() const { return connection_.address; }

  // Creates the stream, its thread and buffers; nothing flows yet. The receiver outlives shut(). Packets are counted in
  // `status`. Thread: setup.
  Status prepare(FrameReceiver& receiver, std::shared_ptr<pipeline::SourceStatus> status,
                 std::vector<std::string>& warnings);
  // Lets frames through to the receiver. Thread: setup.
  void admit() noexcept { gate_.open(); }
  // Starts the camera's acquisition. Thread: setup.
  Status begin();
  // The receiver is not used after it returns. Does not block for long; idempotent. Thread: setup.
  void shut() noexcept { gate_.shut(); }

  // True when Aravis's heartbeat failed, or another program took control. Thread: any.
  bool control_lost() const noexcept { return connection_.control_lost->load(std::memory_order_relaxed); }
  // True when the camera answers; false after about 0.7 s. Thread: setup.
  bool answers() const { return !connection_.is_gige() || answers_gvcp(connection_.address); }
  // True when the camera is controlled by this program. Blocks for seconds when it does not answer. Thread: setup.
  bool controlled() const { return is_controlled(connection_); }
  // Commands a NUC. Blocks for seconds when the camera does not answer. Thread: setup.
  Status trigger_nuc();
  // Writes the NUC mode. Blocks like trigger_nuc(). Thread: setup.
  Status set_nuc(const NucOptions& nuc, std::vector<std::string>& warnings);
  // Clock synchronisation. Blocks like trigger_nuc(). Thread: setup.
  PtpState ptp();
  // Camera temperature, K; 0 when unknown. Blocks like trigger_nuc(). Thread: setup.
  double temperature_k();

 private:
  Session(Connection connection, Negotiated negotiated, const CameraOptions& options);

  static void on_control_lost(ArvDevice* device, void* flag);
  Result<std::size_t> payload_bytes();
  Status start_gvsp(std::size_t payload_bytes, std::shared_ptr<pipeline::SourceStatus> status,
                    std::vector<std::string>& warnings);
  Result<gvsp::StreamPlan> plan_stream(std::size_t payload_bytes, std::vector<std::string>& warnings);
  std::uint16_t source_port();
  std::uint32_t read_register(std::uint64_t address);
  void take(const CameraFrame& frame) noexcept;

  const CameraOptions options_;
  const Negotiated negotiated_;
  bool began_ = false;
  FrameReceiver* receiver_ = nullptr;
  Gate gate_;
  Connection connection_;
  // Exactly one is set, depending on the transport; destroyed before the device.
  std::unique_ptr<gvsp::Receiver> gvsp_;
  std::unique_ptr<AravisStream> other_;
};

// Closes connections on their own threads, because closing that of a dead camera takes seconds. A thread that outlives
// this object owns all that it touches. Thread: one at a time.
class SessionCloser {
 public:
  // The session must be shut already: it delivers no frames.
  void close(std::unique_ptr<Session> session) {
    std::erase_if(closing_, [](const std::future<void>& closed) {
      return closed.wait_for(std::chrono::seconds(0)) == std::future_status::ready;
    });
    std::promise<void> closed;
    closing_.push_back(closed.get_future());
    const auto shared = std::make_shared<std::unique_ptr<Session>>(std::move(session));
    try {
      std::thread([shared, closed = std::move(closed)]() mutable {
        shared->reset();
        closed.set_value();
      }).detach();
    } catch (const std::system_error&) {  // no thread available
      shared->reset();
    }
  }

  // The same, but waits until it is closed, at most `limit`.
  void close_within(std::chrono::milliseconds limit, std::unique_ptr<Session> session) {
    close(std::move(session));
    wait_until(std::chrono::steady_clock::now() + limit);
  }

  // Waits until all are closed or `deadline` has passed.
  void wait_until(std::chrono::steady_clock::time_point deadline) const {
    for (const std::future<void>& closed : closing_) closed.wait_until(deadline);
  }

 private:
  std::vector<std::future<void>> closing_;
};

}  // namespace bolo::genicam

// One acquisition, from AcquisitionStart to its end: a thread that prepares frames and one that sends them on time.
#pragma once

#include <atomic>
#include <string>
#include <thread>

#include "drivers/fakecam/counts.hpp"
#include "drivers/fakecam/frame_faults.hpp"
#include "drivers/fakecam/frame_provider.hpp"
#include "drivers/fakecam/frame_ring.hpp"
#include "drivers/fakecam/packet_train.hpp"
#include "drivers/fakecam/stats.hpp"
#include "drivers/fakecam/timeline.hpp"
#include "src/core/result.hpp"

namespace bolo::fakecam {

// Settings latched at AcquisitionStart.
struct StreamPlan {
  PacketRoute route;
  Region region;  // of the capture's plane
  Region shown;   // the same as the leader shows it: in the coordinates of the sensor
  IrFormat ir_format = IrFormat::kTemperatureLinear10mK;
  double rate_hz = 0.0;      // 0: the capture's own
  std::uint64_t frames = 0;  // to send in all; 0: endless
  std::size_t keep_frames = 48;
  std::int64_t fault_clock_ns = 0;  // what the faults' clock shows when the stream starts
};

// Faults of a stream; all outlive it.
struct StreamFaults {
  FrameFaults& of_frames;
  FaultTallies& tallies;
  std::int64_t period_ns = 0;
};

class StreamSession {
 public:
  // Frames flow from now on. Provider and counters outlive the session. Thread: control.
  StreamSession(const StreamPlan& plan, FrameProvider& provider, Counters& counters, const StreamFaults& faults);
  ~StreamSession();
  StreamSession(const StreamSession&) = delete;
  StreamSession& operator=(const StreamSession&) = delete;

  // No frame goes out after it returns; what was sent can still be sent again. Idempotent. Thread: control.
  void stop() noexcept;

  // True while frames are still to come. Thread: any.
  bool running() const noexcept { return running_.load(std::memory_order_acquire); }  // pairs with send_frames

  // Sends packets of a recent frame again. Thread: control.
  void resend(std::uint16_t block_id, std::uint32_t first, std::uint32_t last) noexcept;

  // CLOCK_MONOTONIC, when a recent frame was due; of any other `now_ns`. Thread: control.
  std::int64_t due_ns(std::uint16_t block_id, std::int64_t now_ns) noexcept;

  // The camera's clock while the stream runs: the time stamp that a frame taken now would bear. Thread: control.
  std::uint64_t camera_time_ns(std::int64_t now_ns) const noexcept;

  // Why the stream ended early, if it did. Thread: control, after stop() or when !running().
  Status result() const;

 private:
  void load_frames();
  void send_frames();
  bool wait_until(std::int64_t due_ns) noexcept;  // false when stopped meanwhile
  void note_lateness(std::int64_t due_ns) noexcept;
  void fill(WireFrame& frame, const Moment& moment, const std::byte* plane);

  StreamPlan plan_;
  FrameProvider& provider_;
  Counters& counters_;
  StreamFaults faults_;
  Timeline timeline_;
  CountConverter converter_;
  FrameRing ring_;
  PacketTrain train_;
  PacketTrain resend_train_;
  std::uint64_t first_timestamp_ns_;
  std::atomic<std::int64_t> start_ns_{0};  // host time of the first frame; 0 before it. Relaxed: nothing hangs on it
  std::atomic<bool> stop_requested_{false};
  std::atomic<bool> running_{true};
  Status result_;  // written by load_frames before the ring is finished, read after running_ turned false
  std::thread loader_;
  std::thread sender_;
};

}  // namespace bolo::fakecam

// One acquisition, AcquisitionStart to end: a thread prepares frames, another sends them as bursts of UDP packets.
#pragma once

#include <netinet/in.h>
#include <sys/socket.h>

#include <array>
#include <atomic>
#include <cstdint>
#include <thread>

#include "drivers/fakecam/faults.hpp"
#include "drivers/fakecam/frames.hpp"
#include "drivers/fakecam/gige_vision.hpp"
#include "drivers/fakecam/stats.hpp"
#include "src/core/result.hpp"

namespace bolo::fakecam {

struct PacketRoute {
  int socket = -1;
  sockaddr_in destination{};
  std::uint32_t packet_size = 1500;     // with IP and UDP headers, gvsp::kMinPacketSize..kMaxPacketSize
  std::uint32_t packet_delay_ns = 0;    // between packets, as an average over a burst
  std::uint32_t burst_gap_ns = 50'000;  // between bursts: lets a receiver with a small socket buffer keep up
};

// Thread: one at a time (the sender and the resender have one each). No allocation after the first frame.
class PacketTrain {
 public:
  PacketTrain(const PacketRoute& route, Counters& counters, PacketFaults faults);
  PacketTrain(const PacketTrain&) = delete;
  PacketTrain& operator=(const PacketTrain&) = delete;

  // Sends packets first..last of the frame (clamped to the frame), subject to network faults. Returns how many the
  // socket took, plus those lost by a fault. Blocks between bursts, and while the socket's send buffer is full.
  std::uint32_t send(const WireFrame& frame, std::uint32_t first, std::uint32_t last) noexcept;
  std::uint32_t send(const WireFrame& frame) noexcept { return send(frame, 0, gvsp::kMaxPacketId); }

  // Reports a packet as unavailable.
  void send_unavailable(std::uint16_t block_id, std::uint32_t packet_id) noexcept;

 private:
  static constexpr std::size_t kBatch = 64;  // packets per system call

  // The only place that decides a packet's content. Fills entry `n` of the batch and returns the packet's bytes.
  std::size_t prepare(std::size_t n, const WireFrame& frame, const gvsp::PacketLayout& layout,
                      const PlannedPacket& packet) noexcept;
  std::uint32_t flush(std::size_t count) noexcept;

  PacketRoute route_;
  Counters& counters_;
  PacketFaults faults_;
  std::array<std::array<std::uint8_t, gvsp::kLeaderBytes>, kBatch> headers_{};
  std::array<std::array<iovec, 2>, kBatch> parts_{};
  std::array<mmsghdr, kBatch> messages_{};
};

// Settings latched at AcquisitionStart.
struct StreamPlan {
  PacketRoute route;
  Region region;  // of the capture's plane
  Region shown;   // the same in sensor coordinates, for the leader
  IrFormat ir_format = IrFormat::kTemperatureLinear10mK;
  double rate_hz = 0.0;      // 0: the capture's rate
  std::uint64_t frames = 0;  // total number; 0: endless
  std::size_t keep_frames = 48;
  std::int64_t fault_clock_ns = 0;  // faults' clock at the stream's start
};

// Faults of a stream; all outlive it.
struct StreamFaults {
  FrameFaults& of_frames;
  FaultTallies& tallies;
  std::int64_t period_ns = 0;
};

class StreamSession {
 public:
  // Starts the stream at once. Provider and counters outlive the session. Thread: control.
  StreamSession(const StreamPlan& plan, const FrameProvider& provider, Counters& counters, const StreamFaults& faults);
  ~StreamSession();

  // No frame is sent after it returns; resends still work. Idempotent. Thread: control.
  void stop() noexcept;

  // True while more frames follow. Thread: any.
  bool running() const noexcept { return running_.load(std::memory_order_acquire); }  // pairs with send_frames

  // Sends packets of a recent frame again. Thread: control.
  void resend(std::uint16_t block_id, std::uint32_t first, std::uint32_t last) noexcept;

  // Due time (CLOCK_MONOTONIC) of a recent frame; `now_ns` for an unknown block id. Thread: control.
  std::int64_t due_ns(std::uint16_t block_id, std::int64_t now_ns) noexcept;

  // Time stamp that a frame taken now would have, while the stream runs. Thread: control.
  std::uint64_t camera_time_ns(std::int64_t now_ns) const noexcept;

  // Error that ended the stream early, if any. Thread: control, after stop() or when !running().
  Status result() const { return result_; }

 private:
  void load_frames();
  void send_frames();
  bool wait_until(std::int64_t due_ns) noexcept;  // false when stopped
  void fill(WireFrame& frame, const Moment& moment, const std::byte* plane);

  StreamPlan plan_;
  const FrameProvider& provider_;
  Counters& counters_;
  StreamFaults faults_;
  Timeline timeline_;
  CountConverter converter_;
  FrameRing ring_;
  PacketTrain train_;
  PacketTrain resend_train_;
  std::uint64_t first_timestamp_ns_;
  std::atomic<std::int64_t> start_ns_{0};  // host time of the first frame; 0 before it. Relaxed: only a number
  std::atomic<bool> stop_requested_{false};
  std::atomic<bool> running_{true};
  Status result_;  // written by load_frames before the ring is finished, read after running_ turned false
  std::thread loader_;
  std::thread sender_;
};

}  // namespace bolo::fakecam

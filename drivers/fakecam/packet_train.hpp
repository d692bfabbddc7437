// Frames as trains of UDP packets, sent in bursts straight from the frame's memory.
#pragma once

#include <netinet/in.h>
#include <sys/socket.h>

#include <array>
#include <cstdint>

#include "drivers/fakecam/frame_ring.hpp"
#include "drivers/fakecam/gige_vision.hpp"
#include "drivers/fakecam/packet_faults.hpp"
#include "drivers/fakecam/stats.hpp"

namespace bolo::fakecam {

// Destination, size and timing of packets.
struct PacketRoute {
  int socket = -1;
  sockaddr_in destination{};
  std::uint32_t packet_size = 1500;      // with IP and UDP headers, gvsp::kMinPacketSize..kMaxPacketSize
  std::uint32_t packet_delay_ns = 0;     // between packets, kept as an average over a burst
  std::uint32_t burst_gap_ns = 50'000;   // between bursts: lets a receiver with a small socket buffer keep up
  std::uint32_t burst_bytes = 32 << 10;  // a burst is at least one packet
};

// Thread: one at a time (the sender and the resender have one each). No allocation once a frame has gone out.
class PacketTrain {
 public:
  PacketTrain(const PacketRoute& route, Counters& counters, PacketFaults faults);
  PacketTrain(const PacketTrain&) = delete;
  PacketTrain& operator=(const PacketTrain&) = delete;

  // Sends packets first..last of the frame (clipped to those it has), as the network's faults let them arrive. Returns
  // how many the socket took, those included that a fault then lost. Blocks between bursts, and while the socket's send
  // buffer is full.
  std::uint32_t send(const WireFrame& frame, std::uint32_t first, std::uint32_t last) noexcept;
  std::uint32_t send(const WireFrame& frame) noexcept { return send(frame, 0, gvsp::kMaxPacketId); }

  // Says that a packet can't be had any more.
  void send_unavailable(std::uint16_t block_id, std::uint32_t packet_id) noexcept;

 private:
  static constexpr std::size_t kBatch = 64;  // packets a system call

  // The one place where a packet's content is decided. Fills place `n` of the batch and returns the packet's bytes.
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

}  // namespace bolo::fakecam

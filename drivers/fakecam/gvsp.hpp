// GVSP, the stream protocol of GigE Vision 1.2 (chapters 22 to 24): a frame is a block of one leader, payload packets
// and one trailer.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>

#include "drivers/fakecam/gvcp.hpp"
#include "drivers/fakecam/wire.hpp"
#include "src/core/geometry.hpp"

namespace bolo::fakecam::gvsp {

inline constexpr std::uint32_t kMono16 = 0x01100007;
inline constexpr std::size_t kHeaderBytes = 8;
inline constexpr std::size_t kLeaderBytes = kHeaderBytes + 36;
inline constexpr std::size_t kTrailerBytes = kHeaderBytes + 8;
inline constexpr std::size_t kUdpOverhead = 20 + 8;  // a packet size counts the IP and UDP headers
inline constexpr std::uint32_t kMinPacketSize = 76;  // the leader fits; 40 bytes of payload
inline constexpr std::uint32_t kMaxPacketSize = 65532;
inline constexpr std::uint32_t kMaxPacketId = 0xffffff;

enum class Content : std::uint8_t { kLeader = 1, kTrailer = 2, kPayload = 3 };

// Fields of the leader.
struct BlockInfo {
  std::uint16_t block_id = 1;  // never 0
  std::uint64_t timestamp_ns = 0;
  Region region;  // where the image lies on the sensor
};

// Packets carry bytes of one block: id 0 the leader, then the payload, last the trailer.
struct PacketLayout {
  std::size_t payload_bytes = 0;  // of the whole frame
  std::size_t data_bytes = 0;     // of each payload packet but the last

  static constexpr PacketLayout of(std::size_t payload_bytes, std::uint32_t packet_size) {
    return {payload_bytes, packet_size - kUdpOverhead - kHeaderBytes};
  }
  constexpr std::uint32_t data_packets() const {
    return static_cast<std::uint32_t>((payload_bytes + data_bytes - 1) / data_bytes);
  }
  constexpr std::uint32_t packets() const { return data_packets() + 2; }
};

// The first kHeaderBytes of `out`. Thread: any.
void write_header(Bytes out, gvcp::Status status, std::uint16_t block_id, Content content, std::uint32_t packet_id);

// The whole packet: kLeaderBytes, kTrailerBytes of `out`. Thread: any.
void write_leader(Bytes out, const BlockInfo& block);
void write_trailer(Bytes out, const BlockInfo& block, std::uint32_t packet_id);

}  // namespace bolo::fakecam::gvsp

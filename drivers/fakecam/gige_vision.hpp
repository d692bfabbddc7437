// GigE Vision 1.2 on the wire: big-endian fields, GVCP (control) and GVSP (stream).
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>

#include "src/core/byte_order.hpp"
#include "src/core/frame.hpp"

namespace bolo::fakecam {

// Fields are written and read byte by byte: no casts, no alignment assumed.
using Bytes = std::span<std::uint8_t>;
using ConstBytes = std::span<const std::uint8_t>;

// The control protocol (chapters 13 to 16).
namespace gvcp {

inline constexpr std::uint16_t kPort = 3956;
inline constexpr std::uint8_t kKey = 0x42;  // first byte of each command
inline constexpr std::uint8_t kAckRequired = 0x01;
inline constexpr std::size_t kHeaderBytes = 8;       // command: key, flags, command, length, id
inline constexpr std::size_t kMaxDataBytes = 540;    // 576-byte IP packet that every host accepts, less headers
inline constexpr std::size_t kDiscoveryBytes = 248;  // the first registers, copied into DISCOVERY_ACK
inline constexpr std::size_t kMaxMemoryBytes = 536;  // of one READMEM or WRITEMEM

enum class Command : std::uint16_t {
  kDiscovery = 0x0002,
  kForceIp = 0x0004,
  kPacketResend = 0x0040,
  kReadRegister = 0x0080,
  kWriteRegister = 0x0082,
  kReadMemory = 0x0084,
  kWriteMemory = 0x0086,
};

constexpr std::uint16_t ack_of(std::uint16_t command) { return static_cast<std::uint16_t>(command + 1); }

enum class Status : std::uint16_t {
  kSuccess = 0x0000,
  kNotImplemented = 0x8001,
  kInvalidParameter = 0x8002,
  kInvalidAddress = 0x8003,
  kWriteProtect = 0x8004,
  kBadAlignment = 0x8005,
  kAccessDenied = 0x8006,
  kBusy = 0x8007,
  kPacketUnavailable = 0x800c,  // in GVSP headers
  kInvalidHeader = 0x800e,
  kWrongConfig = 0x800f,
};

}  // namespace gvcp

// The stream protocol (chapters 22 to 24): a frame is a block of one leader, payload packets and one trailer.
namespace gvsp {

inline constexpr std::uint32_t kMono16 = 0x01100007;
inline constexpr std::uint16_t kImagePayload = 0x0001;
inline constexpr std::size_t kHeaderBytes = 8;
inline constexpr std::size_t kLeaderBytes = kHeaderBytes + 36;
inline constexpr std::size_t kTrailerBytes = kHeaderBytes + 8;
inline constexpr std::size_t kUdpOverhead = 20 + 8;  // a packet size counts the IP and UDP headers
inline constexpr std::uint32_t kMinPacketSize = 76;  // fits the leader and 40 bytes of payload
inline constexpr std::uint32_t kMaxPacketSize = 65532;
inline constexpr std::uint32_t kMaxPacketId = 0xffffff;

enum class Content : std::uint8_t { kLeader = 1, kTrailer = 2, kPayload = 3 };

struct BlockInfo {
  std::uint16_t block_id = 1;  // never 0
  std::uint64_t timestamp_ns = 0;
  Region region;  // of the image on the sensor
};

// Packets of one block: id 0 the leader, then the payload, last the trailer.
struct PacketLayout {
  std::size_t payload_bytes = 0;  // of the whole frame
  std::size_t data_bytes = 0;     // of each payload packet except the last

  static constexpr PacketLayout of(std::size_t payload_bytes, std::uint32_t packet_size) {
    return {payload_bytes, packet_size - kUdpOverhead - kHeaderBytes};
  }
  constexpr std::uint32_t packets() const {
    return static_cast<std::uint32_t>((payload_bytes + data_bytes - 1) / data_bytes) + 2;
  }
};

// Writes the first kHeaderBytes of `out`. Thread: any.
inline void write_header(Bytes out, gvcp::Status status, std::uint16_t block_id, Content content,
                         std::uint32_t packet_id) {
  store_u16(out, 0, static_cast<std::uint16_t>(status));
  store_u16(out, 2, block_id);
  store_u32(out, 4, static_cast<std::uint32_t>(content) << 24U | (packet_id & 0xffffffU));
}

// Write a whole packet: kLeaderBytes, kTrailerBytes of `out`. Thread: any.
inline void write_leader(Bytes out, const BlockInfo& block) {
  write_header(out, gvcp::Status::kSuccess, block.block_id, Content::kLeader, 0);
  const Bytes body = out.subspan(kHeaderBytes);
  store_u16(body, 0, 0);
  store_u16(body, 2, kImagePayload);
  store_u32(body, 4, static_cast<std::uint32_t>(block.timestamp_ns >> 32U));
  store_u32(body, 8, static_cast<std::uint32_t>(block.timestamp_ns));
  store_u32(body, 12, kMono16);
  const auto word = [](int value) { return static_cast<std::uint32_t>(value); };
  store_u32(body, 16, word(block.region.width));
  store_u32(body, 20, word(block.region.height));
  store_u32(body, 24, word(block.region.x));
  store_u32(body, 28, word(block.region.y));
  store_u32(body, 32, 0);  // no padding in x or y
}

inline void write_trailer(Bytes out, const BlockInfo& block, std::uint32_t packet_id) {
  write_header(out, gvcp::Status::kSuccess, block.block_id, Content::kTrailer, packet_id);
  store_u16(out, kHeaderBytes, 0);
  store_u16(out, kHeaderBytes + 2, kImagePayload);
  store_u32(out, kHeaderBytes + 4, static_cast<std::uint32_t>(block.region.height));
}

}  // namespace gvsp
}  // namespace bolo::fakecam

// GVCP, the control protocol of GigE Vision 1.2 (chapters 13 to 16): names of its numbers.
#pragma once

#include <cstddef>
#include <cstdint>

namespace bolo::fakecam::gvcp {

inline constexpr std::uint16_t kPort = 3956;
inline constexpr std::uint8_t kKey = 0x42;  // first byte of each command
inline constexpr std::uint8_t kAckRequired = 0x01;
inline constexpr std::size_t kHeaderBytes = 8;       // command: key, flags, command, length, id
inline constexpr std::size_t kMaxDataBytes = 540;    // 576 bytes of IP packet that every host accepts, less headers
inline constexpr std::size_t kDiscoveryBytes = 248;  // the first registers, as DISCOVERY_ACK repeats them
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

// The acknowledge of a command is the command's number plus one.
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

}  // namespace bolo::fakecam::gvcp

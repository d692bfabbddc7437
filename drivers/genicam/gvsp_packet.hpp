// GVSP, the stream protocol of GigE Vision (2.0, chapters 22 to 25): one datagram, checked and taken apart.
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>

namespace bolo::genicam::gvsp {

inline constexpr std::size_t kNetworkBytes = 20 + 8;  // IP and UDP headers, which a packet size counts
inline constexpr std::size_t kHeaderBytes = 8;
inline constexpr std::size_t kExtendedHeaderBytes = 20;
inline constexpr std::uint32_t kShortPacketId = 0x00ffffff;  // a packet's id where ids are not extended

enum class Content : std::uint8_t { kLeader = 1, kTrailer = 2, kPayload = 3 };

struct Packet {
  Content content = Content::kPayload;
  bool extended = false;        // ids of 64 and 32 bits, not of 16 and 24
  bool refused = false;         // the camera says that it cannot send this packet again; there is no body
  std::uint64_t frame_id = 0;   // GigE Vision: block id
  std::uint32_t packet_id = 0;  // within the frame
  std::span<const std::byte> body{};
};

// Nothing for what is none of the three contents, or too short for its header. Thread: any.
std::optional<Packet> parse(std::span<const std::byte> datagram) noexcept;

struct Leader {
  std::uint64_t ticks = 0;  // the camera's clock
  bool mono16 = false;      // an image of this format; of anything else the rest is 0
  int width = 0;
  int height = 0;
  int x_padding = 0;
};

// Of a leader's body; nothing when it is too short for what it says it is. Thread: any.
std::optional<Leader> parse_leader(std::span<const std::byte> body) noexcept;

// The camera's time in ns, from 0 to below 2^62, so that differences cannot overflow. ticks_per_s: 1 to
// kMostTicksPerSecond. Thread: any.
inline constexpr std::uint64_t kMostTicksPerSecond = 18'000'000'000;
std::int64_t to_ns(std::uint64_t ticks, std::uint64_t ticks_per_s) noexcept;

}  // namespace bolo::genicam::gvsp

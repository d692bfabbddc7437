#include "drivers/genicam/gvsp_packet.hpp"

#include "src/core/byte_order.hpp"

namespace bolo::genicam::gvsp {
namespace {

using Bytes = std::span<const std::byte>;

constexpr std::uint32_t kExtendedIds = 0x80000000;
constexpr std::uint32_t kContentMask = 0x7f000000;
constexpr unsigned kContentShift = 24;
constexpr std::uint16_t kError = 0x8000;
constexpr std::uint16_t kImage = 0x0001;
constexpr std::uint16_t kPayloadTypeMask = 0x3fff;  // above: whether chunks follow
constexpr std::uint32_t kMono16 = 0x01100007;
constexpr std::size_t kShortestLeader = 12;
constexpr std::size_t kImageLeader = 36;
constexpr std::uint32_t kLargestSide = 1U << 16U;

// PACKET_UNAVAILABLE, and removed from the camera's memory, alone or with those before it. Other errors may pass.
bool is_final(std::uint16_t status) noexcept {
  const auto code = static_cast<unsigned>(status & 0xffU);
  return code == 0x0c || code == 0x11 || code == 0x12;
}

bool known(std::uint32_t content) noexcept {
  return content >= static_cast<std::uint32_t>(Content::kLeader) &&
         content <= static_cast<std::uint32_t>(Content::kPayload);
}

}  // namespace

std::optional<Packet> parse(Bytes datagram) noexcept {
  if (datagram.size() < kHeaderBytes) return std::nullopt;
  const std::uint16_t status = load_u16(datagram, 0);
  const std::uint32_t infos = load_u32(datagram, 4);
  Packet packet;
  packet.extended = (infos & kExtendedIds) != 0;
  const std::size_t header = packet.extended ? kExtendedHeaderBytes : kHeaderBytes;
  if (datagram.size() < header) return std::nullopt;
  packet.frame_id = packet.extended ? load_u64(datagram, 8) : load_u16(datagram, 2);
  packet.packet_id = packet.extended ? load_u32(datagram, 16) : infos & kShortPacketId;
  if ((status & kError) != 0) {
    packet.refused = true;
    return is_final(status) ? std::optional(packet) : std::nullopt;
  }
  const std::uint32_t content = (infos & kContentMask) >> kContentShift;
  if (!known(content)) return std::nullopt;
  packet.content = static_cast<Content>(content);
  packet.body = datagram.subspan(header);
  return packet;
}

std::optional<Leader> parse_leader(Bytes body) noexcept {
  if (body.size() < kShortestLeader) return std::nullopt;
  Leader leader;
  leader.ticks = load_u64(body, 4);
  if ((load_u16(body, 2) & kPayloadTypeMask) != kImage) return leader;
  if (body.size() < kImageLeader) return std::nullopt;
  const std::uint32_t width = load_u32(body, 16);
  const std::uint32_t height = load_u32(body, 20);
  if (load_u32(body, 12) != kMono16 || width > kLargestSide || height > kLargestSide) return leader;
  leader.mono16 = true;
  leader.width = static_cast<int>(width);
  leader.height = static_cast<int>(height);
  leader.x_padding = load_u16(body, 32);
  return leader;
}

std::int64_t to_ns(std::uint64_t ticks, std::uint64_t ticks_per_s) noexcept {
  constexpr std::uint64_t kBelow = std::uint64_t{1} << 62U;
  constexpr std::uint64_t kNs = 1'000'000'000;
  const std::uint64_t ns = ticks / ticks_per_s * kNs + ticks % ticks_per_s * kNs / ticks_per_s;
  return static_cast<std::int64_t>(ns % kBelow);
}

}  // namespace bolo::genicam::gvsp

#include "drivers/fakecam/gige_vision.hpp"

namespace bolo::fakecam::gvsp {
namespace {

constexpr std::uint16_t kImagePayload = 0x0001;

std::uint32_t word(int value) { return static_cast<std::uint32_t>(value); }

}  // namespace

void write_header(Bytes out, gvcp::Status status, std::uint16_t block_id, Content content, std::uint32_t packet_id) {
  store_u16(out, 0, static_cast<std::uint16_t>(status));
  store_u16(out, 2, block_id);
  store_u32(out, 4, static_cast<std::uint32_t>(content) << 24U | (packet_id & 0xffffffU));
}

void write_leader(Bytes out, const BlockInfo& block) {
  write_header(out, gvcp::Status::kSuccess, block.block_id, Content::kLeader, 0);
  const Bytes body = out.subspan(kHeaderBytes);
  store_u16(body, 0, 0);
  store_u16(body, 2, kImagePayload);
  store_u32(body, 4, static_cast<std::uint32_t>(block.timestamp_ns >> 32U));
  store_u32(body, 8, static_cast<std::uint32_t>(block.timestamp_ns));
  store_u32(body, 12, kMono16);
  store_u32(body, 16, word(block.region.width));
  store_u32(body, 20, word(block.region.height));
  store_u32(body, 24, word(block.region.x));
  store_u32(body, 28, word(block.region.y));
  store_u32(body, 32, 0);  // no padding in x or y
}

void write_trailer(Bytes out, const BlockInfo& block, std::uint32_t packet_id) {
  write_header(out, gvcp::Status::kSuccess, block.block_id, Content::kTrailer, packet_id);
  store_u16(out, kHeaderBytes, 0);
  store_u16(out, kHeaderBytes + 2, kImagePayload);
  store_u32(out, kHeaderBytes + 4, word(block.region.height));
}

}  // namespace bolo::fakecam::gvsp

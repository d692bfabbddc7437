#include "drivers/fakecam/packet_train.hpp"

#include <algorithm>
#include <cerrno>
#include <ctime>
#include <utility>

namespace bolo::fakecam {
namespace {

void pause_ns(std::uint64_t ns) {
  if (ns == 0) return;
  const timespec span{static_cast<time_t>(ns / 1'000'000'000U), static_cast<long>(ns % 1'000'000'000U)};
  clock_nanosleep(CLOCK_MONOTONIC, 0, &span, nullptr);
}

}  // namespace

PacketTrain::PacketTrain(const PacketRoute& route, Counters& counters, PacketFaults faults)
    : route_(route), counters_(counters), faults_(std::move(faults)) {
  for (std::size_t n = 0; n < kBatch; ++n) {
    parts_[n][0].iov_base = headers_[n].data();
    auto& message = messages_[n].msg_hdr;
    message.msg_name = &route_.destination;
    message.msg_namelen = sizeof(route_.destination);
    message.msg_iov = parts_[n].data();
  }
}

std::size_t PacketTrain::prepare(std::size_t n, const WireFrame& frame, const gvsp::PacketLayout& layout,
                                 const PlannedPacket& packet) noexcept {
  const std::uint32_t packet_id = packet.id;
  auto& [head, body] = parts_[n];
  body = {nullptr, 0};
  if (packet.garbage != 0) {
    head.iov_len = PacketFaults::write_garbage(packet, frame.block.block_id, headers_[n]);
  } else if (packet_id == 0) {
    gvsp::write_leader(headers_[n], frame.block);
    head.iov_len = gvsp::kLeaderBytes;
  } else if (packet_id + 1 == layout.packets()) {
    gvsp::write_trailer(headers_[n], frame.block, packet_id);
    head.iov_len = gvsp::kTrailerBytes;
  } else {
    gvsp::write_header(headers_[n], gvcp::Status::kSuccess, frame.block.block_id, gvsp::Content::kPayload, packet_id);
    head.iov_len = gvsp::kHeaderBytes;
    const std::size_t from = (packet_id - 1) * layout.data_bytes;
    // sendmmsg only reads; iovec has no const form.
    auto* payload = reinterpret_cast<std::uint8_t*>(const_cast<std::uint16_t*>(frame.counts.data()));
    body = {payload + from, std::min(layout.data_bytes, layout.payload_bytes - from)};
  }
  messages_[n].msg_hdr.msg_iovlen = body.iov_len == 0 ? 1 : 2;
  return head.iov_len + body.iov_len;
}

std::uint32_t PacketTrain::flush(std::size_t count) noexcept {
  std::uint32_t taken = 0;
  for (std::size_t from = 0; from < count;) {
    const int n = sendmmsg(route_.socket, &messages_[from], static_cast<unsigned>(count - from), 0);
    if (n > 0) {
      taken += static_cast<std::uint32_t>(n);
      from += static_cast<std::size_t>(n);
    } else if (errno != EINTR) {  // this packet is refused (its size, its route, no memory): go on with the next
      Counters::add(counters_.send_errors);
      ++from;
    }
  }
  Counters::add(counters_.packets_sent, taken);
  return taken;
}

std::uint32_t PacketTrain::send(const WireFrame& frame, std::uint32_t first, std::uint32_t last) noexcept {
  const auto layout = gvsp::PacketLayout::of(frame.payload_bytes(), route_.packet_size);
  const std::uint32_t end = std::min(last, layout.packets() - 1) + 1;
  const auto plan = faults_.plan(frame, first, end);
  std::uint32_t taken = faults_.lost();
  for (std::size_t next = 0; next < plan.size();) {
    std::size_t count = 0;
    for (std::size_t bytes = 0; next < plan.size() && count < kBatch && bytes < route_.burst_bytes; ++count, ++next) {
      bytes += prepare(count, frame, layout, plan[next]);
    }
    taken += flush(count);
    if (next < plan.size()) pause_ns(std::max<std::uint64_t>(route_.burst_gap_ns, count * route_.packet_delay_ns));
  }
  return taken;
}

void PacketTrain::send_unavailable(std::uint16_t block_id, std::uint32_t packet_id) noexcept {
  gvsp::write_header(headers_[0], gvcp::Status::kPacketUnavailable, block_id, gvsp::Content::kPayload, packet_id);
  parts_[0][0].iov_len = gvsp::kHeaderBytes;
  messages_[0].msg_hdr.msg_iovlen = 1;
  flush(1);
}

}  // namespace bolo::fakecam

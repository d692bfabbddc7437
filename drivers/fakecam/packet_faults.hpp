// Faults of the network: packets lost, reordered, duplicated, and garbage among them.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "drivers/fakecam/fault_tally.hpp"
#include "drivers/fakecam/frame_ring.hpp"
#include "drivers/fakecam/gige_vision.hpp"

namespace bolo::fakecam {

// The next packet on the wire: one of the frame, or garbage.
struct PlannedPacket {
  std::uint32_t id = 0;
  std::uint64_t garbage = 0;  // 0: the packet; otherwise what the bytes are made from
  std::uint32_t garbage_bytes = 0;
};

// The packets that are struck follow from the seed, the frame's place in the stream and the packet's id: runs repeat.
// Thread: one at a time (the sender and the resender have one each).
class PacketFaults {
 public:
  // origin_ns: on the faults' clock, when the stream starts. `resends`: packets are sent again, each time another draw.
  // The tallies outlive this.
  PacketFaults(FaultTallies& tallies, std::int64_t period_ns, std::int64_t origin_ns, bool resends);

  // Packets first..end - 1 of the frame as they arrive; valid until the next call.
  std::span<const PlannedPacket> plan(const WireFrame& frame, std::uint32_t first, std::uint32_t end);

  // Of the last plan: packets that were lost.
  std::uint32_t lost() const noexcept { return lost_; }

  // Writes a garbage packet, at most out.size() bytes; returns its length. Half of them have a header, as far as they
  // reach, with 16-bit or extended ids, for a frame far from block_id: a frame near it would be the camera's own.
  static std::size_t write_garbage(const PlannedPacket& packet, std::uint16_t block_id, Bytes out) noexcept;

 private:
  struct Rule {
    FaultKind kind = FaultKind::kLoss;
    std::size_t place = 0;  // in the script
    Schedule schedule;
    double rate = 0.0;
    std::uint32_t amount = 0;  // reorder: how many packets later; garbage: the most bytes
    std::uint64_t key = 0;
  };

  void apply(const Rule& rule, std::uint64_t frame_key);
  void lose(const Rule& rule, std::uint64_t frame_key);
  void reorder(const Rule& rule, std::uint64_t frame_key);
  void insert(const Rule& rule, std::uint64_t frame_key);

  FaultTallies& tallies_;
  std::int64_t origin_ns_;
  bool resends_;
  std::uint64_t attempts_ = 0;
  std::vector<Rule> rules_;  // in the order in which they act: loss last
  std::vector<PlannedPacket> plan_;
  std::vector<PlannedPacket> next_;
  std::uint32_t lost_ = 0;
};

}  // namespace bolo::fakecam

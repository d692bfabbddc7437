#include "drivers/fakecam/packet_faults.hpp"

#include <algorithm>
#include <array>

#include "src/core/splitmix.hpp"

namespace bolo::fakecam {
namespace {

bool strikes_packets(FaultKind kind) {
  constexpr std::array kKinds{FaultKind::kLoss, FaultKind::kReorder, FaultKind::kDuplicate, FaultKind::kGarbage};
  return std::ranges::find(kKinds, kind) != kKinds.end();
}

constexpr std::size_t kMostGarbage = 44;

std::uint64_t draw(std::uint64_t frame_key, const PlannedPacket& packet) { return splitmix::key(frame_key, packet.id); }

bool chance(std::uint64_t random, double rate) { return splitmix::unit(random) < rate; }

}  // namespace

PacketFaults::PacketFaults(FaultTallies& tallies, std::int64_t period_ns, std::int64_t origin_ns, bool resends)
    : tallies_(tallies), origin_ns_(origin_ns), resends_(resends) {
  const FaultScript& script = tallies.script();
  for (std::size_t i = 0; i < script.size(); ++i) {
    const Fault& fault = script[i];
    if (!strikes_packets(fault.kind())) continue;
    Rule rule{fault.kind(), i, frame_schedule_of(fault, period_ns), fault.value("rate"), 0, 0};
    if (fault.kind() == FaultKind::kReorder) rule.amount = static_cast<std::uint32_t>(fault.value("by"));
    if (fault.kind() == FaultKind::kGarbage) rule.amount = static_cast<std::uint32_t>(fault.value("bytes"));
    rule.key = splitmix::key(splitmix::key(static_cast<std::uint64_t>(fault.value("seed")), i), resends ? 1 : 0);
    rules_.push_back(rule);
  }
  std::stable_partition(rules_.begin(), rules_.end(), [](const Rule& rule) { return rule.kind != FaultKind::kLoss; });
}

std::span<const PlannedPacket> PacketFaults::plan(const WireFrame& frame, std::uint32_t first, std::uint32_t end) {
  plan_.clear();
  lost_ = 0;
  for (std::uint32_t id = first; id < end; ++id) plan_.push_back({id, 0, 0});
  const std::uint64_t attempt = resends_ ? ++attempts_ : 0;
  for (const Rule& rule : rules_) {
    if (!rule.schedule.lasts(origin_ns_ + frame.due_ns)) continue;
    apply(rule, splitmix::key(splitmix::key(rule.key, frame.sequence), attempt));
  }
  return plan_;
}

void PacketFaults::apply(const Rule& rule, std::uint64_t frame_key) {
  if (rule.kind == FaultKind::kLoss) return lose(rule, frame_key);
  if (rule.kind == FaultKind::kReorder) return reorder(rule, frame_key);
  insert(rule, frame_key);
}

void PacketFaults::lose(const Rule& rule, std::uint64_t frame_key) {
  const auto goes = [&](const PlannedPacket& packet) {
    return packet.garbage == 0 && chance(draw(frame_key, packet), rule.rate);
  };
  const auto lost = static_cast<std::uint32_t>(std::erase_if(plan_, goes));
  lost_ += lost;
  tallies_.add_packets(rule.place, lost);
  if (lost > 0 && !resends_) tallies_.add_frames(rule.place);
}

// From the last packet to the first, so that each is still where it was drawn.
void PacketFaults::reorder(const Rule& rule, std::uint64_t frame_key) {
  std::uint64_t moved = 0;
  for (std::size_t i = plan_.size(); i-- > 0;) {
    const std::size_t to = std::min(plan_.size() - 1, i + rule.amount);
    if (to == i || !chance(draw(frame_key, plan_[i]), rule.rate)) continue;
    const auto at = [this](std::size_t n) { return plan_.begin() + static_cast<std::ptrdiff_t>(n); };
    std::rotate(at(i), at(i + 1), at(to + 1));
    ++moved;
  }
  tallies_.add_packets(rule.place, moved);
  if (moved > 0 && !resends_) tallies_.add_frames(rule.place);
}

// A packet's double, or garbage, behind it.
void PacketFaults::insert(const Rule& rule, std::uint64_t frame_key) {
  next_.clear();
  for (const PlannedPacket& packet : plan_) {
    next_.push_back(packet);
    const std::uint64_t random = draw(frame_key, packet);
    if (packet.garbage != 0 || !chance(random, rule.rate)) continue;
    const bool garbage = rule.kind == FaultKind::kGarbage;
    next_.push_back(garbage ? PlannedPacket{packet.id, random | 1U, rule.amount} : packet);
  }
  const std::size_t added = next_.size() - plan_.size();
  plan_.swap(next_);
  tallies_.add_packets(rule.place, added);
  if (added > 0 && !resends_) tallies_.add_frames(rule.place);
}

std::size_t PacketFaults::write_garbage(const PlannedPacket& packet, std::uint16_t block_id, Bytes out) noexcept {
  const std::size_t longest = std::min<std::size_t>(packet.garbage_bytes, out.size());
  const std::uint64_t random = splitmix::mix(packet.garbage);
  const std::size_t length = random % (longest + 1);
  std::array<std::uint8_t, kMostGarbage> bytes{};
  for (std::size_t i = 0; i < bytes.size(); ++i) {
    bytes[i] = static_cast<std::uint8_t>(splitmix::key(packet.garbage, i) & 0xffU);
  }
  const std::uint64_t how = random >> 32U;
  const auto far = static_cast<std::uint16_t>(block_id + 0x4000U + (how >> 4U) % 0x8000U);
  const auto ids = static_cast<std::uint32_t>(how >> 20U);
  if ((how & 1U) != 0) {
    const auto content = static_cast<std::uint32_t>(1 + (how >> 1U & 3U)) << 24U;  // the three, and ALL_IN
    const bool extended = (how & 8U) != 0;
    store_u16(bytes, 0, 0);
    store_u16(bytes, 2, far);
    store_u32(bytes, 4, extended ? content | 0x80000000U : content | (ids & 0xffU));
    if (extended) store_u32(bytes, 16, (ids & 1U) != 0 ? ids | 0x70000000U : ids & 0xffU);
  } else {
    store_u16(bytes, 2, far);
  }
  std::copy_n(bytes.begin(), length, out.begin());
  return length;
}

}  // namespace bolo::fakecam

#include "drivers/fakecam/faults.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <string_view>

#include "src/core/byte_order.hpp"
#include "src/core/clock.hpp"
#include "src/core/splitmix.hpp"

namespace bolo::fakecam {
namespace {

constexpr std::size_t kMostGarbage = 44;

std::uint64_t draw(std::uint64_t frame_key, const PlannedPacket& packet) { return splitmix::key(frame_key, packet.id); }

bool chance(std::uint64_t random, double rate) { return splitmix::unit(random) < rate; }

constexpr std::array kOnPackets{FaultKind::kLoss, FaultKind::kReorder, FaultKind::kDuplicate, FaultKind::kGarbage};
// In order of application: pixels from the sensor to the wire.
constexpr std::array kOnFrames{FaultKind::kNuc,      FaultKind::kMetadataRows, FaultKind::kByteOrder, FaultKind::kIdGap,
                               FaultKind::kTimeJump, FaultKind::kStall,        FaultKind::kFreeze};
constexpr std::array kOnControl{FaultKind::kNoResend, FaultKind::kFreeze, FaultKind::kControlLoss, FaultKind::kReboot,
                                FaultKind::kWindowingDrop};

double amount_of(const Fault& fault) {
  for (const std::string_view key : {"by", "bytes", "ids", "offset", "rows"}) {
    if (fault.has(key)) return fault.value(key);
  }
  return 0.0;
}

// The script's faults of these kinds, in script order. `schedule`: schedule_of or frame_schedule_of.
std::vector<FaultRule> rules_of(const FaultScript& script, std::span<const FaultKind> kinds,
                                decltype(schedule_of)& schedule, std::int64_t period_ns) {
  std::vector<FaultRule> rules;
  for (std::size_t i = 0; i < script.size(); ++i) {
    const Fault& fault = script[i];
    if (std::ranges::find(kinds, fault.kind()) == kinds.end()) continue;
    rules.push_back({fault.kind(), i, schedule(fault, period_ns), amount_of(fault), fault.value("rate")});
  }
  return rules;
}

// Programs that use the A6xx find the frame counter in bytes 12 and 13 of the last rows.
constexpr std::size_t kCounterWord = 6;

void write_metadata(std::vector<std::uint16_t>& counts, Geometry geometry, int rows, std::uint64_t frame_id) {
  const auto width = static_cast<std::size_t>(geometry.width);
  for (int y = std::max(0, geometry.height - rows); y < geometry.height; ++y) {
    const auto row = counts.begin() + static_cast<std::ptrdiff_t>(static_cast<std::size_t>(y) * width);
    std::fill_n(row, width, std::uint16_t{0});
    if (width > kCounterWord) row[kCounterWord] = static_cast<std::uint16_t>(frame_id & 0xffffU);
  }
}

void add_offset(std::vector<std::uint16_t>& counts, long offset) {
  for (std::uint16_t& count : counts) {
    count = static_cast<std::uint16_t>(std::clamp(static_cast<long>(count) + offset, 0L, 0xffffL));
  }
}

}  // namespace

PacketFaults::PacketFaults(FaultTallies& tallies, std::int64_t period_ns, std::int64_t origin_ns, bool resends)
    : tallies_(tallies),
      origin_ns_(origin_ns),
      resends_(resends),
      rules_(rules_of(tallies.script(), kOnPackets, frame_schedule_of, period_ns)) {
  for (FaultRule& rule : rules_) {
    const auto seed = static_cast<std::uint64_t>(tallies.script()[rule.place].value("seed"));
    rule.key = splitmix::key(splitmix::key(seed, rule.place), resends ? 1 : 0);
  }
  std::stable_partition(rules_.begin(), rules_.end(),
                        [](const FaultRule& rule) { return rule.kind != FaultKind::kLoss; });
}

std::span<const PlannedPacket> PacketFaults::plan(const WireFrame& frame, std::uint32_t first, std::uint32_t end) {
  plan_.clear();
  lost_ = 0;
  for (std::uint32_t id = first; id < end; ++id) plan_.push_back({id, 0, 0});
  const std::uint64_t attempt = resends_ ? ++attempts_ : 0;
  for (const FaultRule& rule : rules_) {
    if (!rule.schedule.lasts(origin_ns_ + frame.due_ns)) continue;
    const std::uint64_t key = splitmix::key(splitmix::key(rule.key, frame.sequence), attempt);
    const std::size_t struck = rule.kind == FaultKind::kLoss      ? lose(rule, key)
                               : rule.kind == FaultKind::kReorder ? reorder(rule, key)
                                                                  : insert(rule, key);
    tallies_.add_packets(rule.place, struck);
    if (struck > 0 && !resends_) tallies_.add_frames(rule.place);
  }
  return plan_;
}

std::size_t PacketFaults::lose(const FaultRule& rule, std::uint64_t frame_key) {
  const auto goes = [&](const PlannedPacket& packet) {
    return packet.garbage == 0 && chance(draw(frame_key, packet), rule.rate);
  };
  const std::size_t lost = std::erase_if(plan_, goes);
  lost_ += static_cast<std::uint32_t>(lost);
  return lost;
}

// From the last packet to the first, so that earlier positions stay valid.
std::size_t PacketFaults::reorder(const FaultRule& rule, std::uint64_t frame_key) {
  std::size_t moved = 0;
  for (std::size_t i = plan_.size(); i-- > 0;) {
    const std::size_t to = std::min(plan_.size() - 1, i + static_cast<std::size_t>(rule.amount));
    if (to == i || !chance(draw(frame_key, plan_[i]), rule.rate)) continue;
    const auto at = [this](std::size_t n) { return plan_.begin() + static_cast<std::ptrdiff_t>(n); };
    std::rotate(at(i), at(i + 1), at(to + 1));
    ++moved;
  }
  return moved;
}

// Inserts a duplicate or a garbage packet behind each packet drawn.
std::size_t PacketFaults::insert(const FaultRule& rule, std::uint64_t frame_key) {
  next_.clear();
  for (const PlannedPacket& packet : plan_) {
    next_.push_back(packet);
    const std::uint64_t random = draw(frame_key, packet);
    if (packet.garbage != 0 || !chance(random, rule.rate)) continue;
    const bool garbage = rule.kind == FaultKind::kGarbage;
    next_.push_back(garbage ? PlannedPacket{packet.id, random | 1U, static_cast<std::uint32_t>(rule.amount)} : packet);
  }
  plan_.swap(next_);
  return plan_.size() - next_.size();
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
    const auto content = static_cast<std::uint32_t>(1 + (how >> 1U & 3U)) << 24U;  // leader, trailer, payload or ALL_IN
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

FrameFaults::FrameFaults(const FaultScript& script, std::int64_t period_ns)
    : period_ns_(period_ns), rules_(rules_of(script, kOnFrames, frame_schedule_of, period_ns)) {
  std::ranges::stable_sort(rules_, {}, [](const FaultRule& rule) { return std::ranges::find(kOnFrames, rule.kind); });
}

void FrameFaults::begin_stream() noexcept {
  started_ = false;
  held_.clear();
}

void FrameFaults::apply(WireFrame& frame, const Nominal& nominal) {
  frame.hit = 0;
  frame.struck = 0;
  frame.withheld = false;
  const std::int64_t before_ns = started_ ? last_clock_ns_ : nominal.clock_ns - period_ns_;
  for (const FaultRule& rule : rules_) {
    if (rule.schedule.begun(nominal.clock_ns) > rule.schedule.begun(before_ns)) frame.struck |= fault_bit(rule.place);
    strike(rule, frame, nominal);
  }
  started_ = true;
  last_clock_ns_ = nominal.clock_ns;
}

void FrameFaults::strike(const FaultRule& rule, WireFrame& frame, const Nominal& nominal) {
  const bool lasts = rule.schedule.lasts(nominal.clock_ns);
  const auto strikes = static_cast<double>(rule.schedule.begun(nominal.clock_ns));
  if (lasts) frame.hit |= fault_bit(rule.place);
  switch (rule.kind) {
    case FaultKind::kNuc:
      return show_shutter(rule, frame, nominal);
    case FaultKind::kMetadataRows:
      if (lasts) write_metadata(frame.counts, nominal.geometry, static_cast<int>(rule.amount), nominal.frame_id);
      return;
    case FaultKind::kByteOrder:
      if (!lasts) return;
      for (std::uint16_t& count : frame.counts) count = swap_bytes(count);
      return;
    case FaultKind::kIdGap:
      frame.block.block_id = block_id_of(nominal.frame_id + static_cast<std::uint64_t>(strikes * rule.amount));
      return;
    case FaultKind::kTimeJump:
      frame.block.timestamp_ns += static_cast<std::uint64_t>(to_ns(strikes * rule.amount));
      return;
    default:  // stall, freeze
      frame.withheld = frame.withheld || lasts;
  }
}

// While the shutter is closed, the camera repeats the last frame; each completed NUC leaves its offset.
void FrameFaults::show_shutter(const FaultRule& rule, WireFrame& frame, const Nominal& nominal) {
  const auto ended = static_cast<double>(rule.schedule.ended(nominal.clock_ns));
  add_offset(frame.counts, std::lround(ended * rule.amount * nominal.counts_per_kelvin));
  if (!rule.schedule.lasts(nominal.clock_ns) || held_.empty()) {
    held_ = frame.counts;
  } else {
    frame.counts = held_;
  }
}

ControlFaults::ControlFaults(FaultTallies& tallies, std::int64_t period_ns, Actions actions)
    : tallies_(tallies),
      actions_(std::move(actions)),
      rules_(rules_of(tallies.script(), kOnControl, schedule_of, period_ns)) {}

void ControlFaults::begin(std::int64_t now_ns) noexcept {
  if (began_) return;
  began_ = true;
  start_ns_ = now_ns;
}

ControlFaults::Commands ControlFaults::update(std::int64_t now_ns) {
  Commands commands = now_ns < off_until_ns_ ? Commands::kDropped : Commands::kAnswered;
  if (!began_) return commands;
  for (FaultRule& rule : rules_) {
    if (rule.kind == FaultKind::kNoResend || rule.kind == FaultKind::kWindowingDrop) continue;
    const std::int64_t clock = clock_ns(now_ns);
    if (rule.schedule.begun(clock) > rule.seen) {
      rule.seen = rule.schedule.begun(clock);
      strike(rule);
    }
    if (!rule.schedule.lasts(clock)) continue;
    commands = std::max(commands, rule.kind == FaultKind::kFreeze ? Commands::kFrozen : Commands::kDropped);
  }
  return commands;
}

void ControlFaults::strike(FaultRule& rule) {
  if (rule.kind == FaultKind::kFreeze) return;  // its frames are counted where they are withheld
  tallies_.add_time(rule.place);
  if (rule.kind == FaultKind::kControlLoss) actions_.drop_client();
  if (rule.kind == FaultKind::kReboot) actions_.reboot();
}

bool ControlFaults::answers_resend(std::int64_t due_ns) noexcept {
  for (const FaultRule& rule : rules_) {
    if (rule.kind != FaultKind::kNoResend || !rule.schedule.lasts(clock_ns(due_ns))) continue;
    tallies_.add_packets(rule.place);
    return false;
  }
  return true;
}

void ControlFaults::windowing_changed(std::int64_t now_ns) {
  for (const FaultRule& rule : rules_) {
    if (rule.kind != FaultKind::kWindowingDrop) continue;
    tallies_.add_time(rule.place);
    off_until_ns_ = now_ns + rule.schedule.for_ns;
    actions_.drop_client();
  }
}

}  // namespace bolo::fakecam

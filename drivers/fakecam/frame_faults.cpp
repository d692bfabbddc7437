#include "drivers/fakecam/frame_faults.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <string_view>

#include "drivers/fakecam/timeline.hpp"
#include "src/core/byte_order.hpp"
#include "src/core/clock.hpp"

namespace bolo::fakecam {
namespace {

struct Act {
  FaultKind kind;
  std::string_view amount;  // the key that says how much; "" for none
};
constexpr std::array<Act, 7> kActs{{{FaultKind::kNuc, "offset"},
                                    {FaultKind::kMetadataRows, "rows"},
                                    {FaultKind::kByteOrder, ""},
                                    {FaultKind::kIdGap, "ids"},
                                    {FaultKind::kTimeJump, "by"},
                                    {FaultKind::kStall, ""},
                                    {FaultKind::kFreeze, ""}}};

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

FrameFaults::FrameFaults(const FaultScript& script, std::int64_t period_ns) : period_ns_(period_ns) {
  for (const Act& act : kActs) {
    for (std::size_t i = 0; i < script.size(); ++i) {
      if (script[i].kind() != act.kind) continue;
      const double amount = act.amount.empty() ? 0.0 : script[i].value(act.amount);
      rules_.push_back({act.kind, i, frame_schedule_of(script[i], period_ns), amount});
    }
  }
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
  for (const Rule& rule : rules_) {
    if (rule.schedule.begun(nominal.clock_ns) > rule.schedule.begun(before_ns)) frame.struck |= fault_bit(rule.place);
    strike(rule, frame, nominal);
  }
  started_ = true;
  last_clock_ns_ = nominal.clock_ns;
}

void FrameFaults::strike(const Rule& rule, WireFrame& frame, const Nominal& nominal) {
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
      frame.block.timestamp_ns += static_cast<std::uint64_t>(std::llround(strikes * rule.amount * kNsPerSecond));
      return;
    default:  // stall, freeze
      frame.withheld = frame.withheld || lasts;
  }
}

// While the shutter is closed the camera repeats what it saw last; each correction leaves its offset behind.
void FrameFaults::show_shutter(const Rule& rule, WireFrame& frame, const Nominal& nominal) {
  const auto ended = static_cast<double>(rule.schedule.ended(nominal.clock_ns));
  add_offset(frame.counts, std::lround(ended * rule.amount * nominal.counts_per_kelvin));
  if (!rule.schedule.lasts(nominal.clock_ns) || held_.empty()) {
    held_ = frame.counts;
  } else {
    frame.counts = held_;
  }
}

}  // namespace bolo::fakecam

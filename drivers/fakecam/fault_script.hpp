// Faults of the fake camera and their schedules, parsed from text and checked; and their counts.
#pragma once

#include <cstdint>
#include <map>
#include <mutex>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "src/core/result.hpp"

namespace bolo::fakecam {

enum class FaultKind {
  kLoss,
  kReorder,
  kDuplicate,
  kGarbage,
  kNoResend,
  kIdGap,
  kTimeJump,
  kStall,
  kFreeze,
  kControlLoss,
  kReboot,
  kNuc,
  kByteOrder,
  kMetadataRows,
  kWindowingDrop,
};

// One numeric parameter of a fault. A standard value of infinity means "to the end".
struct FaultKey {
  std::string_view key;
  std::string_view unit;  // "" for ratios and counts
  double standard = 0.0;
  double low = 0.0;
  double high = 0.0;
  bool whole = false;  // only whole numbers
  std::string_view about;
};

struct FaultType {
  FaultKind kind = FaultKind::kLoss;
  std::string_view name;
  std::string_view about;
  std::vector<FaultKey> keys;
};

// A fault with its parameters. Keys missing in `values` have their standard value.
struct Fault {
  const FaultType* type = nullptr;
  std::map<std::string, double, std::less<>> values;

  FaultKind kind() const { return type->kind; }
  bool has(std::string_view key) const;  // true when the type has this key
  bool given(std::string_view key) const { return values.contains(key); }
  double value(std::string_view key) const;  // 0 for a key that the type does not have
};

using FaultScript = std::vector<Fault>;

inline constexpr std::size_t kMaxFaults = 32;  // per camera

// All fault types. Thread: any.
std::span<const FaultType> fault_types();

// Parses "NAME" or "NAME:key=value,...". kBadInput: one line with the fault and the nearest name or key. Thread: any.
Result<Fault> parse_fault(std::string_view text);

// Inverse of parse_fault(). Thread: any.
std::string fault_text(const Fault& fault);

// Strike times of a fault, on a clock that starts with the camera's first stream and never stops.
struct Schedule {
  std::int64_t at_ns = 0;
  std::int64_t for_ns = 0;    // duration of each strike; 0: instantaneous
  std::int64_t every_ns = 0;  // from one strike to the next; 0: a single strike

  // Number of strikes that have begun, and of those that have ended. Thread: any.
  std::uint64_t begun(std::int64_t time_ns) const noexcept;
  std::uint64_t ended(std::int64_t time_ns) const noexcept;
  bool lasts(std::int64_t time_ns) const noexcept { return begun(time_ns) > ended(time_ns); }
};

// From the keys at, for or frames, and every. period_ns: frame period. Thread: any.
Schedule schedule_of(const Fault& fault, std::int64_t period_ns);

// Schedule for faults on frames, evaluated at nominal frame times: half a period early, so that rounding moves no frame
// into or out of a strike. N frames are then exactly N. Thread: any.
Schedule frame_schedule_of(const Fault& fault, std::int64_t period_ns);

// Counts of one fault. Frames: sent without some packets (loss), sent changed, or never sent; for id_gap the skipped
// ids. Packets: lost, moved, duplicated or added; for resend_unanswered the requests.
struct InjectedFault {
  std::string fault;        // in the syntax of parse_fault()
  std::uint64_t times = 0;  // observed strikes; 0 for faults that strike single packets
  std::uint64_t frames = 0;
  std::uint64_t packets = 0;
};

// Bit set over the faults of a script, indexed by their place in it.
using FaultSet = std::uint32_t;
static_assert(kMaxFaults <= 32);
constexpr FaultSet fault_bit(std::size_t place) { return FaultSet{1} << place; }

// Thread: any.
class FaultTallies {
 public:
  explicit FaultTallies(const FaultScript& script);

  const FaultScript& script() const noexcept { return script_; }
  void add_time(std::size_t place) noexcept { add(place, &InjectedFault::times, 1); }
  void add_frames(std::size_t place, std::uint64_t n = 1) noexcept { add(place, &InjectedFault::frames, n); }
  void add_packets(std::size_t place, std::uint64_t n = 1) noexcept { add(place, &InjectedFault::packets, n); }

  // Counts a frame that is due: `hit` are the faults that affect it, `struck` those that began with it.
  void add_frame(FaultSet hit, FaultSet struck) noexcept;

  std::vector<InjectedFault> read() const;

 private:
  void add(std::size_t place, std::uint64_t InjectedFault::*count, std::uint64_t n) noexcept;

  const FaultScript script_;
  mutable std::mutex mutex_;
  std::vector<InjectedFault> tallies_;
};

}  // namespace bolo::fakecam

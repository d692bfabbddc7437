// Counts of the script's faults.
#pragma once

#include <atomic>
#include <bit>
#include <cstdint>
#include <string>
#include <vector>

#include "drivers/fakecam/fault_script.hpp"

namespace bolo::fakecam {

// Counts of one fault. Frames: sent without some of their packets (loss), sent changed, or never sent; of id_gap
// the ids that no frame got. Packets: lost, moved, doubled or added ones; of resend_unanswered the requests.
struct InjectedFault {
  std::string fault;        // as parse_fault() reads it
  std::uint64_t times = 0;  // strikes that were seen; packets are struck one by one
  std::uint64_t frames = 0;
  std::uint64_t packets = 0;
};

// One set of bits for the faults of a script, by their place in it.
using FaultSet = std::uint32_t;
static_assert(kMaxFaults <= 32);
constexpr FaultSet fault_bit(std::size_t place) { return FaultSet{1} << place; }

// Counters stand alone: all accesses are relaxed. Thread: any.
class FaultTallies {
 public:
  explicit FaultTallies(const FaultScript& script) : script_(script), tallies_(script.size()) {}

  const FaultScript& script() const noexcept { return script_; }
  void add_time(std::size_t place) noexcept { add(tallies_[place].times, 1); }
  void add_frames(std::size_t place, std::uint64_t n = 1) noexcept { add(tallies_[place].frames, n); }
  void add_packets(std::size_t place, std::uint64_t n = 1) noexcept { add(tallies_[place].packets, n); }

  // A frame's turn has come: the faults that it shows, and those that began with it.
  void add_frame(FaultSet hit, FaultSet struck) noexcept {
    for (; hit != 0; hit &= hit - 1) add_frames(static_cast<std::size_t>(std::countr_zero(hit)));
    for (; struck != 0; struck &= struck - 1) strike(static_cast<std::size_t>(std::countr_zero(struck)));
  }

  std::vector<InjectedFault> read() const {
    std::vector<InjectedFault> all;
    for (std::size_t i = 0; i < script_.size(); ++i) {
      const auto value = [](const Counter& counter) { return counter.load(std::memory_order_relaxed); };
      const Tally& tally = tallies_[i];
      all.push_back({fault_text(script_[i]), value(tally.times), value(tally.frames), value(tally.packets)});
    }
    return all;
  }

 private:
  using Counter = std::atomic<std::uint64_t>;
  struct Tally {
    Counter times{0};
    Counter frames{0};
    Counter packets{0};
  };

  static void add(Counter& counter, std::uint64_t n) noexcept { counter.fetch_add(n, std::memory_order_relaxed); }
  void strike(std::size_t place) noexcept {
    add_time(place);
    const Fault& fault = script_[place];
    if (fault.kind() == FaultKind::kIdGap) add_frames(place, static_cast<std::uint64_t>(fault.value("ids")));
  }

  const FaultScript script_;
  std::vector<Tally> tallies_;
};

}  // namespace bolo::fakecam

// Faults of the camera as a whole: freeze, power loss, control taken away, resend requests left unanswered.
#pragma once

#include <cstdint>
#include <functional>
#include <vector>

#include "drivers/fakecam/fault_tally.hpp"

namespace bolo::fakecam {

// Thread: control.
class ControlFaults {
 public:
  enum class Commands {
    kAnswered,
    kFrozen,   // they wait in the socket, as for a stopped process
    kDropped,  // as for a camera without power
  };
  struct Actions {
    std::function<void()> drop_client;  // ends its control and its stream
    std::function<void()> reboot;       // drops the client; all registers as at power-on
  };
  ControlFaults(FaultTallies& tallies, std::int64_t period_ns, Actions actions);

  // The first stream starts: the faults' clock is 0 here. Later calls change nothing.
  void begin(std::int64_t now_ns) noexcept;
  // The faults' clock; before begin() it stands at 0.
  std::int64_t clock_ns(std::int64_t now_ns) const noexcept { return began_ ? now_ns - start_ns_ : 0; }

  // True when update() has to be called on time.
  bool any() const noexcept { return !rules_.empty(); }

  // Executes the faults that are due; returns how commands are answered until the next call.
  Commands update(std::int64_t now_ns);

  // False when a resend request for a frame that was due at `due_ns` is left unanswered, which is counted. By the
  // frame's time, so that on a busy machine, too, it covers the very packets that another fault took meanwhile.
  bool answers_resend(std::int64_t due_ns) noexcept;

  // The client has written another IRWindowing.
  void windowing_changed(std::int64_t now_ns);

 private:
  struct Rule {
    FaultKind kind = FaultKind::kReboot;
    std::size_t place = 0;  // in the script
    Schedule schedule;
    std::uint64_t seen = 0;  // strikes that were acted on
  };
  void strike(Rule& rule);

  FaultTallies& tallies_;
  Actions actions_;
  std::vector<Rule> rules_;
  bool began_ = false;
  std::int64_t start_ns_ = 0;
  std::int64_t off_until_ns_ = 0;  // after a change of windowing
};

}  // namespace bolo::fakecam

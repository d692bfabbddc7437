// Effects of a script's faults on packets, on frames, and on the camera as a whole.
#pragma once

#include <cstdint>
#include <functional>
#include <span>
#include <vector>

#include "drivers/fakecam/fault_script.hpp"
#include "drivers/fakecam/frames.hpp"
#include "drivers/fakecam/gige_vision.hpp"
#include "src/core/frame.hpp"

namespace bolo::fakecam {

struct FaultRule {
  FaultKind kind = FaultKind::kLoss;
  std::size_t place = 0;  // in the script
  Schedule schedule;
  double amount = 0.0;     // ids, seconds, kelvin, rows; reorder: positions to move by; garbage: maximum bytes
  double rate = 0.0;       // share of the packets
  std::uint64_t key = 0;   // seed of the packet draw
  std::uint64_t seen = 0;  // strikes on the camera already executed
};

struct PlannedPacket {
  std::uint32_t id = 0;
  std::uint64_t garbage = 0;  // 0: a real packet; otherwise the seed of the garbage bytes
  std::uint32_t garbage_bytes = 0;
};

// The packets to strike follow from the seed, the frame's place in the stream and the packet id, so runs are
// repeatable. Thread: one at a time (the sender and the resender have one each).
class PacketFaults {
 public:
  // origin_ns: stream start on the faults' clock. `resends`: true for resent packets, each attempt is a new draw. The
  // tallies outlive this.
  PacketFaults(FaultTallies& tallies, std::int64_t period_ns, std::int64_t origin_ns, bool resends);

  // Packets first..end - 1 of the frame in order of arrival; valid until the next call.
  std::span<const PlannedPacket> plan(const WireFrame& frame, std::uint32_t first, std::uint32_t end);

  std::uint32_t lost() const noexcept { return lost_; }

  // Writes a garbage packet of at most out.size() bytes; returns its length. Half of them have a (possibly truncated)
  // header with 16-bit or extended ids, for a block far from block_id: a near one would pass for the camera's own.
  static std::size_t write_garbage(const PlannedPacket& packet, std::uint16_t block_id, Bytes out) noexcept;

 private:
  // Each changes plan_ and returns the number of packets struck.
  std::size_t lose(const FaultRule& rule, std::uint64_t frame_key);
  std::size_t reorder(const FaultRule& rule, std::uint64_t frame_key);
  std::size_t insert(const FaultRule& rule, std::uint64_t frame_key);

  FaultTallies& tallies_;
  std::int64_t origin_ns_;
  bool resends_;
  std::uint64_t attempts_ = 0;
  std::vector<FaultRule> rules_;  // in order of application: loss last
  std::vector<PlannedPacket> plan_;
  std::vector<PlannedPacket> next_;
  std::uint32_t lost_ = 0;
};

// Thread: one at a time (the stream's loader).
class FrameFaults {
 public:
  struct Nominal {
    std::int64_t clock_ns = 0;  // due time on the faults' clock
    std::uint64_t frame_id = 0;
    Geometry geometry;
    double counts_per_kelvin = 1.0;
  };

  FrameFaults(const FaultScript& script, std::int64_t period_ns);

  // Starts a new stream and forgets the state of the last one.
  void begin_stream() noexcept;

  // Applies and records the faults active at the frame's time. The frame must be complete: pixels, block, due time.
  void apply(WireFrame& frame, const Nominal& nominal);

 private:
  void strike(const FaultRule& rule, WireFrame& frame, const Nominal& nominal);
  void show_shutter(const FaultRule& rule, WireFrame& frame, const Nominal& nominal);

  std::int64_t period_ns_;
  std::vector<FaultRule> rules_;  // in order of application: pixels from the sensor to the wire
  bool started_ = false;
  std::int64_t last_clock_ns_ = 0;   // of the previous frame
  std::vector<std::uint16_t> held_;  // repeated while the shutter is closed
};

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
    std::function<void()> reboot;       // drops the client; resets all registers to power-on
  };
  ControlFaults(FaultTallies& tallies, std::int64_t period_ns, Actions actions);

  // Starts the faults' clock at 0 with the first stream. Later calls change nothing.
  void begin(std::int64_t now_ns) noexcept;
  // Time on the faults' clock; 0 before begin().
  std::int64_t clock_ns(std::int64_t now_ns) const noexcept { return began_ ? now_ns - start_ns_ : 0; }

  // True when update() must be called regularly.
  bool any() const noexcept { return !rules_.empty(); }

  // Executes the faults that are due; returns how to answer commands until the next call.
  Commands update(std::int64_t now_ns);

  // False when a resend request for a frame due at `due_ns` must stay unanswered (counted). Judged by the frame's time,
  // so that even on a busy machine it covers exactly the packets that another fault took in that interval.
  bool answers_resend(std::int64_t due_ns) noexcept;

  // Called when the client has written another IRWindowing.
  void windowing_changed(std::int64_t now_ns);

 private:
  void strike(FaultRule& rule);

  FaultTallies& tallies_;
  Actions actions_;
  std::vector<FaultRule> rules_;
  bool began_ = false;
  std::int64_t start_ns_ = 0;
  std::int64_t off_until_ns_ = 0;  // after a change of windowing
};

}  // namespace bolo::fakecam

// Effects of a script's faults on the packets on the network, on frames, and on the camera as a whole.
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

// A fault of the script and its times.
struct FaultRule {
  FaultKind kind = FaultKind::kLoss;
  std::size_t place = 0;  // in the script
  Schedule schedule;
  double amount = 0.0;     // ids, seconds, kelvin, rows; reorder: how many packets later; garbage: the most bytes
  double rate = 0.0;       // of packets
  std::uint64_t key = 0;   // of the draw of packets
  std::uint64_t seen = 0;  // strikes on the camera that were acted on
};

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
  // These change plan_ and return how many packets they struck.
  std::size_t lose(const FaultRule& rule, std::uint64_t frame_key);
  std::size_t reorder(const FaultRule& rule, std::uint64_t frame_key);
  std::size_t insert(const FaultRule& rule, std::uint64_t frame_key);

  FaultTallies& tallies_;
  std::int64_t origin_ns_;
  bool resends_;
  std::uint64_t attempts_ = 0;
  std::vector<FaultRule> rules_;  // in the order in which they act: loss last
  std::vector<PlannedPacket> plan_;
  std::vector<PlannedPacket> next_;
  std::uint32_t lost_ = 0;
};

// Thread: one at a time (the stream's loader).
class FrameFaults {
 public:
  // A frame without faults.
  struct Nominal {
    std::int64_t clock_ns = 0;  // when it is due, on the faults' clock
    std::uint64_t frame_id = 0;
    Geometry geometry;
    double counts_per_kelvin = 1.0;
  };

  FrameFaults(const FaultScript& script, std::int64_t period_ns);

  // A stream begins: what it shows of the past is forgotten.
  void begin_stream() noexcept;

  // Applies the faults that last at the frame's time, and notes them in it. The frame is complete: pixels, block, due
  // time.
  void apply(WireFrame& frame, const Nominal& nominal);

 private:
  void strike(const FaultRule& rule, WireFrame& frame, const Nominal& nominal);
  void show_shutter(const FaultRule& rule, WireFrame& frame, const Nominal& nominal);

  std::int64_t period_ns_;
  std::vector<FaultRule> rules_;  // in the order in which they act: pixels from the sensor to the wire
  bool started_ = false;
  std::int64_t last_clock_ns_ = 0;   // of the frame before
  std::vector<std::uint16_t> held_;  // what the camera repeats while its shutter is closed
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
  void strike(FaultRule& rule);

  FaultTallies& tallies_;
  Actions actions_;
  std::vector<FaultRule> rules_;
  bool began_ = false;
  std::int64_t start_ns_ = 0;
  std::int64_t off_until_ns_ = 0;  // after a change of windowing
};

}  // namespace bolo::fakecam

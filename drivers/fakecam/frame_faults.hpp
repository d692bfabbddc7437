// Faults of the camera in its frames: wrong ids, times and pixels, and frames not sent at all.
#pragma once

#include <cstdint>
#include <vector>

#include "drivers/fakecam/fault_tally.hpp"
#include "drivers/fakecam/frame_ring.hpp"
#include "src/core/geometry.hpp"

namespace bolo::fakecam {

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

  // Changes the frame as the faults that last at its time say, and notes them in it. The frame is complete: pixels,
  // block, due time.
  void apply(WireFrame& frame, const Nominal& nominal);

 private:
  struct Rule {
    FaultKind kind = FaultKind::kStall;
    std::size_t place = 0;  // in the script
    Schedule schedule;
    double amount = 0.0;  // ids, seconds, kelvin, rows
  };

  void strike(const Rule& rule, WireFrame& frame, const Nominal& nominal);
  void show_shutter(const Rule& rule, WireFrame& frame, const Nominal& nominal);

  std::int64_t period_ns_;
  std::vector<Rule> rules_;  // in the order in which they act: pixels from the sensor to the wire
  bool started_ = false;
  std::int64_t last_clock_ns_ = 0;   // of the frame before
  std::vector<std::uint16_t> held_;  // what the camera repeats while its shutter is closed
};

}  // namespace bolo::fakecam

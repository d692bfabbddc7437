// Numbers frames: by the counter in their header where there is one, else by their order.
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>

#include "drivers/usb/frame_layout.hpp"

namespace bolo::usb {

// A bulk endpoint delivers in order, so a counter that goes back was reset, and one that stands still repeats a frame.
// Thread: acquire. No allocation.
class FrameNumbers {
 public:
  // period_s: the camera's frame period, to tell many lost frames from a counter that was reset.
  FrameNumbers(std::optional<CounterField> counter, double period_s) noexcept;

  struct Place {
    std::uint64_t frame_id = 0;  // unwrapped
    std::uint64_t missing = 0;   // frames before this one of which nothing came, beyond those told by lost()
    bool repeated = false;       // the frame before again
    bool restarted = false;      // frames before and after do not belong together
  };

  // A whole frame arrived. arrival_ns: CLOCK_MONOTONIC.
  Place place(std::span<const std::byte> frame, std::int64_t arrival_ns) noexcept;
  // A frame was lost and counted: it took a number too.
  void lost() noexcept { ++lost_; }
  // The stream was interrupted: how many frames passed meanwhile is known only to a counter, and not even to that where
  // the camera began anew.
  void interrupted(bool camera_began_anew) noexcept;

 private:
  Place follow(std::uint64_t steps) noexcept;
  std::int64_t steps_to(std::uint64_t raw) const noexcept;

  std::optional<CounterField> counter_;
  double period_ns_;
  bool started_ = false;
  bool began_anew_ = false;
  std::uint64_t last_ = 0;      // unwrapped
  std::uint64_t last_raw_ = 0;  // as in the header
  std::int64_t last_ns_ = 0;
  std::uint64_t lost_ = 0;  // since the last
};

}  // namespace bolo::usb

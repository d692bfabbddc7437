// What happens to the bytes of the camera: cut into frames, copied into pool slots, handed in; or counted as lost.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>

#include "drivers/usb/frame_assembler.hpp"
#include "drivers/usb/frame_layout.hpp"
#include "drivers/usb/frame_numbers.hpp"
#include "src/pipeline/inlet.hpp"

namespace bolo::usb {

// Outlives the connections of one start() to stop(): after a reconnect ids and losses go on.
class Intake {
 public:
  // The inlet outlives this; its format's geometry is the layout's. Thread: setup.
  Intake(pipeline::FrameInlet& inlet, const FrameLayout& layout);

  // The bytes of one transfer; ended: a short packet was the last. Thread: acquire.
  void take(std::span<const std::byte> bytes, bool ended) noexcept;
  // More came than a transfer holds: the frame is not of the agreed size. Thread: acquire.
  void overflowed() noexcept;
  // A transfer failed after so many bytes: a frame that had begun is lost (kDriver). Thread: acquire.
  void failed(std::size_t bytes) noexcept;
  // The camera was opened again; a frame that had begun is lost (kDriver). Thread: acquire.
  void reopened() noexcept;

  // Whole frames so far. Thread: acquire.
  std::uint64_t frames() const noexcept { return frames_; }
  // CLOCK_MONOTONIC of the last whole frame, 0 before the first. Thread: acquire.
  std::int64_t last_frame_ns() const noexcept { return last_frame_ns_; }

 private:
  void deliver(std::span<const std::byte> frame) noexcept;
  void lose(LossCause cause) noexcept;

  pipeline::FrameInlet& inlet_;
  const FrameLayout layout_;
  const double period_ns_;
  FrameAssembler assembler_;
  FrameNumbers numbers_;
  std::uint64_t frames_ = 0;
  std::int64_t last_frame_ns_ = 0;
};

}  // namespace bolo::usb

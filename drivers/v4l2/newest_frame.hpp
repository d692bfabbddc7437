// Hands the newest frame from one thread to another; neither waits for the other.
#pragma once

#include <array>
#include <atomic>
#include <cstddef>
#include <cstdint>
#include <vector>

namespace bolo::v4l2 {

// Three frames: one that the writer fills, one that the reader holds, one between them. To hand over is to exchange
// one's own with the one between:
//
//   writer                         between              reader
//   fills w
//   between <- w|fresh, w <- old   (w, fresh)
//                                                       between <- r, r <- w: the newest, and not fresh any more
//
// A frame that is still fresh when the writer takes it back was never seen. Each exchange releases what was written
// into the frame given away and acquires what the other side did with the frame received.
template <typename Frame>
class NewestFrame {
 public:
  explicit NewestFrame(const Frame& frame) : frames_{frame, frame, frame} {}

  // To be filled, then handed over. Thread: the writer's.
  Frame& filling() noexcept { return frames_[writer_]; }
  // True when the one before it was never taken. Thread: the writer's.
  bool hand_over() noexcept {
    const std::uint8_t back = between_.exchange(writer_ | kFresh, std::memory_order_acq_rel);  // partner: take()
    writer_ = back & kIndex;
    return (back & kFresh) != 0;
  }

  // The newest frame, the reader's until the next take(); null when there is none that is new. Thread: the reader's.
  const Frame* take() noexcept {
    if ((between_.load(std::memory_order_relaxed) & kFresh) == 0) return nullptr;     // the exchange orders
    const std::uint8_t back = between_.exchange(reader_, std::memory_order_acq_rel);  // partner: hand_over()
    reader_ = back & kIndex;
    return &frames_[reader_];
  }

 private:
  static constexpr std::uint8_t kIndex = 3;
  static constexpr std::uint8_t kFresh = 4;
  std::array<Frame, 3> frames_;
  std::uint8_t writer_ = 0;
  std::uint8_t reader_ = 1;
  std::atomic<std::uint8_t> between_{2};
};

}  // namespace bolo::v4l2

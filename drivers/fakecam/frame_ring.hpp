// Frames on their way out: a reader fills slots ahead of time, the sender takes them in order, and what was sent stays
// for a while, so that lost packets can be sent again.
#pragma once

#include <condition_variable>
#include <cstdint>
#include <mutex>
#include <vector>

#include "drivers/fakecam/fault_script.hpp"
#include "drivers/fakecam/gige_vision.hpp"

namespace bolo::fakecam {

struct WireFrame {
  gvsp::BlockInfo block;
  std::uint64_t sequence = 0;
  std::int64_t due_ns = 0;            // after the stream's first frame
  bool withheld = false;              // never goes out
  FaultSet hit = 0;                   // faults that it shows
  FaultSet struck = 0;                // faults that begin with it
  std::vector<std::uint16_t> counts;  // little-endian on the wire, as the host has them

  std::size_t payload_bytes() const { return counts.size() * sizeof(std::uint16_t); }
};

// Frame s lies in slot s % slots. Four positions: written >= sent, ahead of sent by at most `ahead`; a slot is filled
// again only when its frame was sent, is `keep` frames old and nobody has it pinned. One mutex guards the positions;
// no plane is touched under it. Thread: one writer, one sender, any number of finders.
class FrameRing {
 public:
  FrameRing(std::size_t ahead, std::size_t keep, std::size_t pixels);

  // A recently sent frame that stays as it is until the pin goes. Empty when the frame is gone or not sent yet.
  class Pin {
   public:
    Pin(FrameRing& ring, const WireFrame* frame) : ring_(ring), frame_(frame) {}
    ~Pin();
    Pin(const Pin&) = delete;
    Pin& operator=(const Pin&) = delete;
    const WireFrame* frame() const { return frame_; }

   private:
    FrameRing& ring_;
    const WireFrame* frame_;
  };

  // The slot to fill next; waits for one. nullptr once the ring is closed. Thread: writer.
  WireFrame* begin_write();
  void end_write();
  void finish();  // no frame comes after those written

  // The next frame; waits for one. nullptr once the ring is closed, or finished and empty. Thread: sender.
  const WireFrame* begin_send();
  void end_send();

  // The youngest frame with this block id of those sent or being sent. Thread: any.
  Pin find(std::uint16_t block_id);

  // Wakes everybody and ends all waiting. Thread: any.
  void close();

 private:
  std::size_t slot(std::uint64_t sequence) const { return static_cast<std::size_t>(sequence % frames_.size()); }

  std::mutex mutex_;
  std::condition_variable changed_;
  std::vector<WireFrame> frames_;
  std::vector<int> pins_;
  std::size_t ahead_;
  std::uint64_t written_ = 0;  // frames filled
  std::uint64_t sent_ = 0;     // frames sent
  std::uint64_t visible_ = 0;  // frames sent or being sent
  std::uint64_t oldest_ = 0;   // the oldest frame whose slot was not given to the writer again
  bool finished_ = false;
  bool closed_ = false;
};

}  // namespace bolo::fakecam

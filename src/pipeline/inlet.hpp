// Entry of the pipeline for a source: frame pool, frame queue and loss counters.
#pragma once

#include <atomic>
#include <cstdint>

#include "src/core/loss.hpp"
#include "src/rt/counters.hpp"
#include "src/rt/frame_pool.hpp"
#include "src/rt/spsc_queue.hpp"

namespace bolo::pipeline {

class FrameInlet {
 public:
  // Allocates pool and queue; `window_slots`: kept by the window; `queue_slots`: frames that may wait. Thread: setup.
  FrameInlet(const StreamFormat& format, std::size_t window_slots, std::size_t queue_slots);

  const StreamFormat& format() const noexcept { return format_; }

  // --- the source's side. Thread: acquire ---

  // A slot to fill (meta reset), or nullptr if none is free; that loss (kPoolExhausted) is counted. Never blocks.
  rt::FrameSlot* borrow() noexcept;

  // As borrow(), but waits for a slot until stop_requested: nothing is lost. For sources that can be slowed (files).
  rt::FrameSlot* borrow_wait(const std::atomic<bool>& stop_requested) noexcept;

  // Passes the filled slot on. False if the queue was full: kQueueFull is counted, the slot taken back.
  bool commit(rt::FrameSlot& slot) noexcept;

  // Takes back an unfilled slot: the frame turned out bad while it was copied. Counts nothing.
  void cancel(rt::FrameSlot& slot) noexcept;

  // Thread: any.
  void count_loss(LossCause cause, std::uint64_t frames = 1) noexcept { losses_.add(cause, frames); }
  // Frames that reached the queue. Thread: any.
  std::uint64_t received() const noexcept { return received_.value(); }
  const rt::LossCounters& losses() const noexcept { return losses_; }

  // The source has no more frames: the pipeline drains the queue and ends. Thread: acquire.
  void finish() noexcept;

  // The camera's state changed (reconnect, NUC): the next committed frame starts a new window. Thread: acquire.
  void restart_window() noexcept { restart_window_ = true; }

  // --- the pipeline's side. Thread: pipeline ---

  struct Arrival {
    rt::FrameSlot* slot = nullptr;
    bool restart_window = false;
    std::int64_t commit_ns = 0;  // CLOCK_MONOTONIC of its entry into the queue
  };
  // Waits up to timeout_ns, and not at all once the source has finished; slot is nullptr if nothing came.
  Arrival next(std::int64_t timeout_ns) noexcept;
  // True after the source's finish(). Read it before a next() that finds nothing: only then is nothing left.
  bool finished() const noexcept { return finished_.load(std::memory_order_acquire); }  // partner: finish()
  void give_back(rt::FrameSlot& slot) noexcept { pool_.give_back(slot); }
  void give_back(std::uint32_t slot_index) noexcept { pool_.give_back(pool_.slot(slot_index)); }

 private:
  struct Entry {
    std::uint32_t slot = 0;
    bool restart_window = false;
    std::int64_t commit_ns = 0;
  };
  StreamFormat format_;
  rt::FramePool pool_;
  rt::SpscQueue<Entry> queue_;
  rt::LossCounters losses_;
  rt::Counter received_;
  rt::FrameSlot* spare_ = nullptr;  // a cancelled slot, kept for the next borrow(); acquire thread only
  bool restart_window_ = false;     // acquire thread only
  std::atomic<bool> finished_{false};
};

}  // namespace bolo::pipeline

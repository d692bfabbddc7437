#include "bolo/pipeline/inlet.hpp"

#include <utility>

namespace bolo::pipeline {
namespace {

// How often a waiting source looks whether it should stop.
constexpr std::int64_t kStopCheckNs = 50'000'000;

}  // namespace

// The queue can hold every slot of the pool: a full queue then means a full pool, and frames are lost by one cause only
// unless a caller asks for a shorter queue.
FrameInlet::FrameInlet(const StreamFormat& format, std::size_t window_slots, std::size_t queue_slots)
    : format_(format), pool_(format, window_slots + queue_slots), queue_(queue_slots) {}

rt::FrameSlot* FrameInlet::borrow() noexcept {
  if (spare_ != nullptr) return std::exchange(spare_, nullptr);
  rt::FrameSlot* slot = pool_.take();
  if (slot == nullptr) losses_.add(LossCause::kPoolExhausted);
  return slot;
}

rt::FrameSlot* FrameInlet::borrow_wait(const std::atomic<bool>& stop_requested) noexcept {
  if (spare_ != nullptr) return std::exchange(spare_, nullptr);
  while (!stop_requested.load(std::memory_order_relaxed)) {
    if (rt::FrameSlot* slot = pool_.take_wait(kStopCheckNs)) return slot;
  }
  return nullptr;
}

bool FrameInlet::commit(rt::FrameSlot& slot) noexcept {
  if (!queue_.try_push({slot.index, restart_pending_})) {
    losses_.add(LossCause::kQueueFull);
    cancel(slot);
    return false;
  }
  restart_pending_ = false;
  received_.add();
  return true;
}

void FrameInlet::cancel(rt::FrameSlot& slot) noexcept { spare_ = &slot; }

void FrameInlet::finish() noexcept {
  finished_.store(true, std::memory_order_release);  // partner: finished(); every push came before
  queue_.wake();
}

FrameInlet::Arrival FrameInlet::next(std::int64_t timeout_ns) noexcept {
  Entry entry;
  if (!queue_.pop_wait(entry, timeout_ns)) return {};
  return {&pool_.slot(entry.slot), entry.restarts_window};
}

}  // namespace bolo::pipeline

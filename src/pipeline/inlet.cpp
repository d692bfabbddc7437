#include "src/pipeline/inlet.hpp"

#include <utility>

#include "src/core/clock.hpp"

namespace bolo::pipeline {
namespace {

// A waiting source checks for a stop at this interval.
constexpr std::int64_t kStopCheckNs = 50'000'000;

}  // namespace

// Besides the window's and the queue's slots there is one that the source fills and one that the pipeline has just
// taken. The queue can hold every slot: until the window is full, its slots are free too, and a source that waited for
// one must find room. So frames are lost only for lack of slots (kPoolExhausted); kQueueFull guards against a slot's
// second commit.
FrameInlet::FrameInlet(const StreamFormat& format, std::size_t window_slots, std::size_t queue_slots)
    : format_(format), pool_(format, window_slots + queue_slots + 2), queue_(pool_.size()) {}

rt::FrameSlot* FrameInlet::borrow() noexcept {
  rt::FrameSlot* slot = spare_ != nullptr ? std::exchange(spare_, nullptr) : pool_.take();
  if (slot == nullptr) {
    losses_.add(LossCause::kPoolExhausted);
    return nullptr;
  }
  slot->meta = {};
  return slot;
}

rt::FrameSlot* FrameInlet::borrow_wait(const std::atomic<bool>& stop_requested) noexcept {
  rt::FrameSlot* slot = std::exchange(spare_, nullptr);
  while (slot == nullptr && !stop_requested.load(std::memory_order_relaxed)) slot = pool_.take_wait(kStopCheckNs);
  if (slot != nullptr) slot->meta = {};
  return slot;
}

bool FrameInlet::commit(rt::FrameSlot& slot) noexcept {
  received_.add();  // before it can be taken: otherwise more frames could be published than received
  if (!queue_.try_push({slot.index, restart_window_, monotonic_ns()})) {
    received_.take_back();
    losses_.add(LossCause::kQueueFull);
    cancel(slot);
    return false;
  }
  restart_window_ = false;
  return true;
}

void FrameInlet::cancel(rt::FrameSlot& slot) noexcept { spare_ = &slot; }

void FrameInlet::finish() noexcept {
  finished_.store(true, std::memory_order_release);  // partner: finished(); every push came before
  queue_.wake();
}

FrameInlet::Arrival FrameInlet::next(std::int64_t timeout_ns) noexcept {
  Entry entry;
  if (!queue_.pop_wait(entry, finished() ? 0 : timeout_ns)) return {};
  return {&pool_.slot(entry.slot), entry.restart_window, entry.commit_ns};
}

}  // namespace bolo::pipeline

// Bounded lock-free queue between one producer thread and one consumer thread.
//
// The race, step by step. Indices only grow; a cell is index & mask.
//
//   producer                                  consumer
//   --------                                  --------
//   P1 head_.load(acquire)  <-- pairs C3      C1 tail_.load(acquire)  <-- pairs P3
//      full when tail - head == capacity         empty when head == tail
//   P2 cell[tail] = value        (plain)      C2 value = cell[head]       (plain)
//   P3 tail_.store(tail+1, release)           C3 head_.store(head+1, release)
//
// P2 happens before C2 of the same cell through P3 -> C1, and C2 happens before the P2 that reuses the cell through
// C3 -> P1. No cell is touched by both sides at once, so plain values are enough. Each side keeps its last look at the
// other's index and loads it again only when that look says full or empty: the cache line travels once a lap, not
// once an item.
//
// A consumer may sleep. The semaphore carries no data, only the wake-up; it is posted after P3, so a consumer that
// found the queue empty and then waits is woken by the post of the item it missed. A surplus count only costs one
// more look at an empty queue.
#pragma once

#include <semaphore.h>

#include <atomic>
#include <bit>
#include <cstddef>
#include <cstdint>
#include <ctime>
#include <memory>
#include <type_traits>

namespace bolo::rt {

// std::hardware_destructive_interference_size is not ABI-stable and warns; x86-64 and ARMv8 lines are 64 bytes.
inline constexpr std::size_t kCacheLine = 64;

template <typename T>
class SpscQueue {
  static_assert(std::is_trivially_copyable_v<T>, "items are copied without constructors");

 public:
  // Room for at least `capacity` items, rounded up to a power of two. Allocates; Thread: setup.
  explicit SpscQueue(std::size_t capacity)
      : mask_(std::bit_ceil(capacity < 1 ? 1 : capacity) - 1), cells_(std::make_unique<T[]>(mask_ + 1)) {
    sem_init(&wake_, 0, 0);
  }
  ~SpscQueue() { sem_destroy(&wake_); }
  SpscQueue(const SpscQueue&) = delete;
  SpscQueue& operator=(const SpscQueue&) = delete;

  std::size_t capacity() const noexcept { return mask_ + 1; }

  // False when full; never blocks. Thread: the producer.
  bool try_push(T value) noexcept {
    const std::uint64_t tail = tail_.load(std::memory_order_relaxed);
    if (tail - seen_head_ > mask_) {
      seen_head_ = head_.load(std::memory_order_acquire);  // partner: C3
      if (tail - seen_head_ > mask_) return false;
    }
    cells_[tail & mask_] = value;
    tail_.store(tail + 1, std::memory_order_release);  // partner: C1
    sem_post(&wake_);
    return true;
  }

  // False when empty; never blocks. Thread: the consumer.
  bool try_pop(T& value) noexcept {
    const std::uint64_t head = head_.load(std::memory_order_relaxed);
    if (head == seen_tail_) {
      seen_tail_ = tail_.load(std::memory_order_acquire);  // partner: P3
      if (head == seen_tail_) return false;
    }
    value = cells_[head & mask_];
    head_.store(head + 1, std::memory_order_release);  // partner: P1
    return true;
  }

  // Waits up to timeout_ns for an item, or until wake() is called; false when none came. Thread: the consumer.
  bool pop_wait(T& value, std::int64_t timeout_ns) noexcept {
    if (try_pop(value)) return true;
    timespec until{};
    clock_gettime(CLOCK_MONOTONIC, &until);
    const std::int64_t ns = until.tv_nsec + timeout_ns;
    until.tv_sec += ns / 1'000'000'000;
    until.tv_nsec = ns % 1'000'000'000;
    while (sem_clockwait(&wake_, CLOCK_MONOTONIC, &until) == 0) {
      if (try_pop(value)) return true;
      if (woken_.exchange(false, std::memory_order_acquire)) return false;  // partner: wake()
    }
    return try_pop(value);
  }

  // Ends a pop_wait() early. Thread: any.
  void wake() noexcept {
    woken_.store(true, std::memory_order_release);  // partner: pop_wait()
    sem_post(&wake_);
  }

 private:
  const std::uint64_t mask_;
  const std::unique_ptr<T[]> cells_;
  alignas(kCacheLine) std::atomic<std::uint64_t> tail_{0};  // written by the producer
  std::uint64_t seen_head_ = 0;                             // the producer's last look at head_
  alignas(kCacheLine) std::atomic<std::uint64_t> head_{0};  // written by the consumer
  std::uint64_t seen_tail_ = 0;                             // the consumer's last look at tail_
  alignas(kCacheLine) sem_t wake_{};
  std::atomic<bool> woken_{false};
};

}  // namespace bolo::rt

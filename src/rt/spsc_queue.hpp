// Bounded lock-free queue between one producer thread and one consumer thread.
//
// The race, step by step (tests/models tries every order). Indices only grow; a cell is index & mask.
//
//   producer                                  consumer
//   --------                                  --------
//   P1 head_.load(acquire)  <-- pairs C3      C1 tail_.load(seq_cst)  <-- pairs P3
//      full when tail - head == capacity         empty when head == tail
//   P2 cell[tail] = value        (plain)      C2 value = cell[head]       (plain)
//   P3 tail_.store(tail+1, seq_cst)           C3 head_.store(head+1, release)
//
// P2 happens before C2 of the same cell through P3 -> C1, and C2 happens before the P2 that reuses the cell through
// C3 -> P1. No cell is touched by both sides at once, so plain values are enough. Each side caches the other's index
// and loads it again only when the cached one means full or empty: the cache line travels once a lap, not once an item.
//
// A consumer may sleep. It first announces that and then checks once more; the producer first publishes and then checks
// for a sleeper (wake() does the same with woken_ in the place of tail_):
//
//   producer                                  consumer
//   --------                                  --------
//   P3 tail_.store(tail+1, seq_cst)           S1 take back bells rung too late for an earlier sleep
//   P4 sleeping_ ? (seq_cst)                  S2 sleeping_.store(true, seq_cst)
//   P5 sleeping_.exchange(false) -> ring      S3 C1 again: empty ? (seq_cst)
//                                             S4 wait for the bell, then from S1 again
//
// All four are in the single order of seq_cst operations. Either P3 comes before S3, which then finds the item, or
// S2, S3, P3, P4 come in this order and P4 finds the sleeper: an item is never left behind a sleeping consumer. P5 lets
// one announcement ring at most one bell, and S1 takes back what was not needed: the semaphore holds at most the bell
// of this announcement and, from each thread that may ring, one that comes late.
#pragma once

#include <semaphore.h>

#include <atomic>
#include <bit>
#include <cerrno>
#include <cstddef>
#include <cstdint>
#include <ctime>
#include <memory>
#include <type_traits>

namespace bolo::rt {

// std::hardware_destructive_interference_size is not ABI-stable and warns; x86-64 and ARMv8 lines are 64 bytes.
inline constexpr std::size_t kCacheLine = 64;

// Debian's queues (readerwriterqueue, Boost) are as fast, but their sleepers cannot be woken without an item.
template <typename T>
class SpscQueue {
  static_assert(std::is_trivially_copyable_v<T>, "items are copied without constructors");

 public:
  // Room for at least `capacity` items, rounded up to a power of two. Allocates; Thread: setup.
  explicit SpscQueue(std::size_t capacity)
      : mask_(std::bit_ceil(capacity < 1 ? 1 : capacity) - 1), cells_(std::make_unique<T[]>(mask_ + 1)) {
    sem_init(&bell_, 0, 0);
  }
  ~SpscQueue() { sem_destroy(&bell_); }

  std::size_t capacity() const noexcept { return mask_ + 1; }

  // False when full; never blocks. Thread: the producer.
  bool try_push(T value) noexcept {
    const std::uint64_t tail = tail_.load(std::memory_order_relaxed);
    if (tail - seen_head_ > mask_) {
      seen_head_ = head_.load(std::memory_order_acquire);  // partner: C3
      if (tail - seen_head_ > mask_) return false;
    }
    cells_[tail & mask_] = value;
    tail_.store(tail + 1, std::memory_order_seq_cst);  // P3; partners: C1, and S2 through P4
    ring_if_sleeping();
    return true;
  }

  // False when empty; never blocks. Thread: the consumer.
  bool try_pop(T& value) noexcept {
    const std::uint64_t head = head_.load(std::memory_order_relaxed);
    if (head == seen_tail_) {
      seen_tail_ = tail_.load(std::memory_order_seq_cst);  // C1; partner: P3
      if (head == seen_tail_) return false;
    }
    value = cells_[head & mask_];
    head_.store(head + 1, std::memory_order_release);  // partner: P1
    return true;
  }

  // Waits up to timeout_ns for an item, or until wake() is called; false when none came. Thread: the consumer.
  bool pop_wait(T& value, std::int64_t timeout_ns) noexcept {
    if (try_pop(value)) return true;
    const timespec until = after(timeout_ns);
    for (bool in_time = true; in_time;) {
      while (sem_trywait(&bell_) == 0) continue;                // S1
      sleeping_.store(true, std::memory_order_seq_cst);         // S2; partner: P4
      if (try_pop(value)) return stay_awake(true);              // S3
      if (woken_.exchange(false, std::memory_order_seq_cst)) {  // S3; partner: wake()
        return stay_awake(false);
      }
      in_time = sem_clockwait(&bell_, CLOCK_MONOTONIC, &until) == 0 || errno == EINTR;  // S4
    }
    return stay_awake(try_pop(value));
  }

  // Ends the running pop_wait(), or the next one, early. Thread: any.
  void wake() noexcept {
    woken_.store(true, std::memory_order_seq_cst);  // partner: S3
    ring_if_sleeping();
  }

  // Bells rung and not yet heard: at most one more than there are threads that ring. Thread: any.
  int bells() const noexcept {
    int count = 0;
    sem_getvalue(&bell_, &count);
    return count;
  }

 private:
  void ring_if_sleeping() noexcept {
    if (!sleeping_.load(std::memory_order_seq_cst)) return;                      // P4; partner: S2
    if (sleeping_.exchange(false, std::memory_order_seq_cst)) sem_post(&bell_);  // P5
  }

  // Relaxed: S1 takes back a bell that is rung before the producer sees this.
  bool stay_awake(bool result) noexcept {
    sleeping_.store(false, std::memory_order_relaxed);
    return result;
  }

  static timespec after(std::int64_t timeout_ns) noexcept {
    constexpr std::int64_t kSecond = 1'000'000'000;
    timespec t{};
    clock_gettime(CLOCK_MONOTONIC, &t);
    const std::int64_t ns = t.tv_nsec + (timeout_ns > 0 ? timeout_ns : 0);
    t.tv_sec += ns / kSecond;
    t.tv_nsec = ns % kSecond;
    return t;
  }

  const std::uint64_t mask_;
  const std::unique_ptr<T[]> cells_;
  alignas(kCacheLine) std::atomic<std::uint64_t> tail_{0};  // written by the producer
  std::uint64_t seen_head_ = 0;                             // head_ as the producer last loaded it
  alignas(kCacheLine) std::atomic<std::uint64_t> head_{0};  // written by the consumer
  std::uint64_t seen_tail_ = 0;                             // tail_ as the consumer last loaded it
  alignas(kCacheLine) std::atomic<bool> sleeping_{false};   // the consumer waits, or is about to
  std::atomic<bool> woken_{false};
  mutable sem_t bell_{};
};

}  // namespace bolo::rt

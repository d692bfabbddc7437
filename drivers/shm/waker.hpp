// Wakes the readers that wait on a futex in shared memory, at a cost that their number does not raise.
//
// A wake-up costs the caller some 2 us for each process that it wakes, and anybody who may read may wait, with as many
// threads as he likes. So the caller itself wakes a few, which are all there usually are; a thread of its own wakes the
// rest.
#pragma once

#include <atomic>
#include <cstdint>
#include <thread>

namespace bolo::shm {

class Waker {
 public:
  // `word` must outlive this. Thread: setup.
  explicit Waker(std::uint32_t& word);
  ~Waker();
  Waker(const Waker&) = delete;
  Waker& operator=(const Waker&) = delete;

  // Wakes all that wait on the word, some of them a little later. The word was changed before. Thread: pipeline.
  void wake() noexcept;

 private:
  void end() noexcept;
  void run() noexcept;

  std::uint32_t& word_;
  std::atomic<std::uint32_t> asked_{0};  // times that there was a rest to wake
  std::atomic<bool> ends_{false};
  std::thread thread_;
};

}  // namespace bolo::shm

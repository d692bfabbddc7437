// Readers that wait on the futex word: however many they are, none sleeps on.
#include "drivers/shm/waker.hpp"

#include <gtest/gtest.h>
#include <linux/futex.h>
#include <sys/syscall.h>
#include <unistd.h>

#include <atomic>
#include <memory>
#include <thread>
#include <vector>

#include "drivers/shm/shared_words.hpp"

namespace bolo::shm {
namespace {

// As ShmReader waits, but without an end.
void wait_for_change(const std::uint32_t& word, std::uint32_t seen) {
  while (load_acquire(word) == seen) syscall(SYS_futex, &word, FUTEX_WAIT, seen, nullptr, nullptr, 0);
}

TEST(Waker, WakesAllOfAFewAndOfMany) {
  constexpr std::uint32_t kRounds = 100;
  for (const int readers : {1, 4, 5, 20}) {
    std::uint32_t word = 0;
    Waker waker(word);
    std::vector<std::thread> threads;
    std::atomic<std::uint32_t> arrivals{0};
    for (int i = 0; i < readers; ++i) {
      threads.emplace_back([&] {
        for (std::uint32_t seen = 0; seen < kRounds; ++seen) {
          ++arrivals;
          wait_for_change(word, seen);
        }
      });
    }
    for (std::uint32_t round = 0; round < kRounds; ++round) {
      while (arrivals < (round + 1) * static_cast<std::uint32_t>(readers)) std::this_thread::yield();
      store_release(word, round + 1);
      waker.wake();
    }
    for (std::thread& thread : threads) thread.join();
    EXPECT_EQ(arrivals, kRounds * static_cast<std::uint32_t>(readers));
  }
}

TEST(Waker, ItsEndWakesWhoStillWaits) {
  std::uint32_t word = 0;
  auto waker = std::make_unique<Waker>(word);
  std::vector<std::thread> threads;
  for (int i = 0; i < 8; ++i) threads.emplace_back([&] { wait_for_change(word, 0); });
  store_release(word, std::uint32_t{1});
  waker = nullptr;
  for (std::thread& thread : threads) thread.join();
}

}  // namespace
}  // namespace bolo::shm

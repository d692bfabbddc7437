// Lock-free sharing between threads: queue, pool, counters.
#include "src/rt/spsc_queue.hpp"
#include "bolo/shm_layout.h"
#include "src/core/clock.hpp"
#include "src/rt/counters.hpp"
#include "src/rt/frame_pool.hpp"
#include "tests/test.hpp"

namespace bolo::rt::spsc_queue_test {

constexpr std::int64_t kMs = 1'000'000;
constexpr std::int64_t kHangGuardNs = 60'000 * kMs;

TEST(SpscQueue, RoundsItsCapacityUpToAPowerOfTwo) {
  EXPECT_EQ(SpscQueue<int>(0).capacity(), 1U);
  EXPECT_EQ(SpscQueue<int>(1).capacity(), 1U);
  EXPECT_EQ(SpscQueue<int>(5).capacity(), 8U);
  EXPECT_EQ(SpscQueue<int>(64).capacity(), 64U);
}

TEST(SpscQueue, TakesAsMuchAsItHoldsInOrderRoundAndRound) {
  SpscQueue<int> queue(2);
  int value = -1;
  const auto pop = [&] { return queue.try_pop(value) ? value : -1; };
  for (int i = 0; i < 3000; i += 3) {
    ASSERT_TRUE(queue.try_push(i) && queue.try_push(i + 1));
    ASSERT_FALSE(queue.try_push(-2));
    ASSERT_EQ(pop(), i);
    ASSERT_TRUE(queue.try_push(i + 2)) << "a cell is free again";
    ASSERT_FALSE(queue.try_push(-2));
    ASSERT_EQ(pop(), i + 1);
    ASSERT_EQ(pop(), i + 2);
    ASSERT_EQ(pop(), -1);
  }
}

TEST(SpscQueue, PopWaitGivesUpAfterItsTimeoutAndNotBefore) {
  SpscQueue<int> queue(2);
  int value = -1;
  const std::int64_t start = monotonic_ns();
  EXPECT_FALSE(queue.pop_wait(value, 20 * kMs));
  EXPECT_GE(monotonic_ns() - start, 20 * kMs);
  EXPECT_FALSE(queue.pop_wait(value, 0));
  EXPECT_FALSE(queue.pop_wait(value, -kMs));
}

TEST(SpscQueue, WakeEndsAPopWaitThatRuns) {
  SpscQueue<int> queue(2);
  std::jthread other([&] {
    std::this_thread::sleep_for(std::chrono::milliseconds(20));
    queue.wake();
  });
  int value = -1;
  const std::int64_t start = monotonic_ns();
  EXPECT_FALSE(queue.pop_wait(value, kHangGuardNs));
  EXPECT_LT(monotonic_ns() - start, kHangGuardNs);
}

TEST(SpscQueue, WakeBeforehandEndsTheNextPopWaitOnce) {
  SpscQueue<int> queue(2);
  queue.wake();
  int value = -1;
  const std::int64_t start = monotonic_ns();
  EXPECT_FALSE(queue.pop_wait(value, kHangGuardNs));
  EXPECT_LT(monotonic_ns() - start, kHangGuardNs);
  EXPECT_FALSE(queue.pop_wait(value, 20 * kMs));
  EXPECT_GE(monotonic_ns() - start, 20 * kMs);
}

TEST(SpscQueue, AnItemThatIsThereComesBeforeAWake) {
  SpscQueue<int> queue(2);
  queue.wake();
  queue.try_push(3);
  int value = -1;
  EXPECT_TRUE(queue.pop_wait(value, kHangGuardNs));
  EXPECT_EQ(value, 3);
}

TEST(SpscQueue, NobodyAsleepRingsNoBell) {
  SpscQueue<int> queue(2);
  int value = -1;
  for (int i = 0; i < 1000; ++i) {
    ASSERT_TRUE(queue.try_push(i));
    ASSERT_TRUE(queue.pop_wait(value, kHangGuardNs));
    queue.wake();
  }
  EXPECT_EQ(queue.bells(), 0);
}

// A number and its double: reveals torn or stale cells.
struct Pair {
  std::uint64_t number;
  std::uint64_t twice;
};

// The consumer polls, or sleeps with a timeout so long that a lost wake-up would exceed the test's own limit.
void stress(std::size_t capacity, std::uint64_t items, bool consumer_sleeps, bool producer_pauses) {
  SpscQueue<Pair> queue(capacity);
  std::thread producer([&] {
    for (std::uint64_t i = 0; i < items; ++i) {
      while (!queue.try_push({i, 2 * i})) std::this_thread::yield();
      if (producer_pauses && i % 64 == 0) std::this_thread::yield();
    }
  });
  for (std::uint64_t expected = 0; expected < items; ++expected) {
    Pair pair{};
    if (consumer_sleeps) {
      ASSERT_TRUE(queue.pop_wait(pair, kHangGuardNs)) << "a wake-up was lost at item " << expected;
    } else {
      while (!queue.try_pop(pair)) std::this_thread::yield();
    }
    ASSERT_EQ(pair.number, expected);
    ASSERT_EQ(pair.twice, 2 * expected);
    ASSERT_LE(queue.bells(), 2);  // this announcement's and a late one
  }
  producer.join();
  Pair pair{};
  EXPECT_FALSE(queue.try_pop(pair));
}

TEST(SpscQueueStress, PollingConsumer) { stress(16, 200'000, false, false); }
TEST(SpscQueueStress, SleepingConsumer) { stress(16, 200'000, true, false); }
TEST(SpscQueueStress, SleepingConsumerOfOneCell) { stress(1, 50'000, true, false); }
TEST(SpscQueueStress, ConsumerThatIsFaster) { stress(64, 100'000, true, true); }

TEST(SpscQueueStress, WakesFromAThirdThreadLoseNoItem) {
  SpscQueue<Pair> queue(4);
  constexpr std::uint64_t kItems = 20'000;
  std::atomic<bool> stop{false};
  std::jthread waker([&] {
    while (!stop.load()) {
      queue.wake();
      std::this_thread::yield();
    }
  });
  std::jthread producer([&] {
    for (std::uint64_t i = 0; i < kItems; ++i) {
      while (!queue.try_push({i, 2 * i})) std::this_thread::yield();
    }
  });
  std::uint64_t expected = 0;
  while (expected < kItems) {
    Pair pair{};
    if (!queue.pop_wait(pair, kHangGuardNs)) continue;
    EXPECT_EQ(pair.number, expected);
    ++expected;
  }
  stop.store(true);
}

StreamFormat small_format(PixelType type = PixelType::kUint16) { return {.geometry = {7, 3}, .type = type}; }

TEST(FramePool, PlanesAreAlignedZeroedAndApart) {
  FramePool pool(small_format(PixelType::kFloat32), 5);
  EXPECT_EQ(pool.size(), 5U);
  EXPECT_EQ(pool.plane_bytes(), 7U * 3U * 4U);
  for (std::uint32_t i = 0; i < 5; ++i) {
    FrameSlot& slot = pool.slot(i);
    EXPECT_EQ(slot.index, i);
    EXPECT_EQ(reinterpret_cast<std::uintptr_t>(slot.data) % 64, 0U);
    for (std::size_t b = 0; b < pool.plane_bytes(); ++b) ASSERT_EQ(slot.data[b], std::byte{0});
    for (std::size_t b = 0; b < pool.plane_bytes(); ++b) slot.data[b] = std::byte{0xff};
  }
}

TEST(FramePool, GivesEachSlotOnceAndAgainOnceItIsBack) {
  FramePool pool(small_format(), 6);
  std::set<FrameSlot*> taken;
  for (int i = 0; i < 6; ++i) {
    FrameSlot* slot = pool.take();
    ASSERT_NE(slot, nullptr);
    taken.insert(slot);
  }
  EXPECT_EQ(taken.size(), 6U);
  EXPECT_EQ(pool.take(), nullptr);
  EXPECT_EQ(pool.take_wait(1'000'000), nullptr);
  FrameSlot* const back = *taken.begin();
  pool.give_back(*back);
  EXPECT_EQ(pool.take(), back);
  EXPECT_EQ(pool.take(), nullptr);
}

// Slots circulate between two threads; what one writes the other reads whole.
TEST(FramePool, SlotsGoRoundBetweenTwoThreads) {
  FramePool pool(small_format(), 3);
  SpscQueue<std::uint32_t> filled(4);
  constexpr std::uint16_t kFrames = 5000;
  std::jthread driver([&] {
    for (std::uint16_t n = 0; n < kFrames; ++n) {
      FrameSlot* slot = pool.take_wait(60'000'000'000);
      ASSERT_NE(slot, nullptr);
      for (int i = 0; i < 21; ++i) slot->u16()[i] = n;
      slot->meta.frame_id = n;
      ASSERT_TRUE(filled.try_push(slot->index));
    }
  });
  for (std::uint16_t n = 0; n < kFrames; ++n) {
    std::uint32_t index = 0;
    ASSERT_TRUE(filled.pop_wait(index, 60'000'000'000));
    FrameSlot& slot = pool.slot(index);
    ASSERT_EQ(slot.meta.frame_id, n);
    for (int i = 0; i < 21; ++i) ASSERT_EQ(slot.u16()[i], n);
    pool.give_back(slot);
  }
}

TEST(Counters, FitIntoSharedMemoryAndAllLossesHaveNames) {
  EXPECT_EQ(LatencyHistogram::kBuckets, BOLO_SHM_LATENCY_BUCKETS);
  EXPECT_LE(kLossCauses, BOLO_SHM_LOSS_CAUSES);
  for (std::size_t i = 0; i < kLossCauses; ++i) EXPECT_FALSE(name(static_cast<LossCause>(i)).empty());
}

TEST(LatencyHistogram, BucketsFollowTheLayoutsRule) {
  for (std::size_t b = 8; b < LatencyHistogram::kBuckets; ++b) {
    const std::size_t e = b / 8;
    const std::size_t m = b % 8;
    const auto lower_us = static_cast<std::int64_t>((8 + m) << (e - 1));
    const auto upper_us = static_cast<std::int64_t>((9 + m) << (e - 1));
    EXPECT_EQ(LatencyHistogram::bucket(lower_us * 1000), b);
    EXPECT_EQ(LatencyHistogram::bucket(upper_us * 1000 - 1), b);
    EXPECT_DOUBLE_EQ(LatencyHistogram::upper_ms(b), static_cast<double>(upper_us) * 1e-3);
  }
}

TEST(LatencyHistogram, EndsTakeWhatIsBeyondThem) {
  EXPECT_EQ(LatencyHistogram::bucket(-5), 0U);
  EXPECT_EQ(LatencyHistogram::bucket(0), 0U);
  EXPECT_EQ(LatencyHistogram::bucket(7'999), 7U);
  EXPECT_EQ(LatencyHistogram::bucket(8'000), 8U);
  EXPECT_EQ(LatencyHistogram::bucket(INT64_MAX), LatencyHistogram::kBuckets - 1);
}

TEST(LatencyHistogram, PercentilesAreNeverBelowAndAtMostAnEighthAboveTheTrueOnes) {
  std::mt19937 random(1);
  std::lognormal_distribution<double> latency_us(std::log(2000.0), 1.5);
  LatencyHistogram histogram;
  std::vector<double> true_ms;
  for (int i = 0; i < 20'000; ++i) {
    const double us = latency_us(random);
    histogram.add(static_cast<std::int64_t>(us * 1e3));
    true_ms.push_back(us * 1e-3);
  }
  std::sort(true_ms.begin(), true_ms.end());
  const auto counts = histogram.counts();
  for (const double fraction : {0.01, 0.5, 0.9, 0.99, 0.999, 1.0}) {
    const auto rank = static_cast<std::size_t>(std::ceil(fraction * 20'000)) - 1;
    const double read = LatencyHistogram::percentile_ms(counts, fraction);
    EXPECT_GE(read, true_ms[rank]) << fraction;
    EXPECT_LE(read, true_ms[rank] * 1.125 + 1e-3) << fraction;
  }
}

TEST(LatencyHistogram, PercentileOfOneAndOfNone) {
  LatencyHistogram histogram;
  EXPECT_EQ(LatencyHistogram::percentile_ms(histogram.counts(), 0.5), 0.0);
  histogram.add(3'500);
  for (const double fraction : {0.0, 0.5, 1.0}) {
    EXPECT_DOUBLE_EQ(LatencyHistogram::percentile_ms(histogram.counts(), fraction), 0.004);
  }
}

}  // namespace bolo::rt::spsc_queue_test

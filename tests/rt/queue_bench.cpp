// Our queue beside those of Debian's libraries: items a second when both sides poll, and how late a sleeping consumer
// sees an item of a stream of frames.
#include <benchmark/benchmark.h>

#include <readerwriterqueue/readerwritercircularbuffer.h>

#include <algorithm>
#include <boost/lockfree/spsc_queue.hpp>
#include <chrono>
#include <cstdint>
#include <thread>
#include <vector>

#include "src/core/clock.hpp"
#include "src/rt/spsc_queue.hpp"

namespace {

constexpr std::size_t kCapacity = 64;
constexpr std::int64_t kForeverNs = 10'000'000'000;

struct Ours {
  bool push(std::int64_t value) { return queue.try_push(value); }
  bool pop(std::int64_t& value) { return queue.try_pop(value); }
  bool wait(std::int64_t& value) { return queue.pop_wait(value, kForeverNs); }
  bolo::rt::SpscQueue<std::int64_t> queue{kCapacity};
};

struct Moodycamel {
  bool push(std::int64_t value) { return queue.try_enqueue(value); }
  bool pop(std::int64_t& value) { return queue.try_dequeue(value); }
  bool wait(std::int64_t& value) { return queue.wait_dequeue_timed(value, std::chrono::nanoseconds(kForeverNs)); }
  moodycamel::BlockingReaderWriterCircularBuffer<std::int64_t> queue{kCapacity};
};

struct Boost {  // has no way to sleep
  bool push(std::int64_t value) { return queue.push(value); }
  bool pop(std::int64_t& value) { return queue.pop(value); }
  boost::lockfree::spsc_queue<std::int64_t> queue{kCapacity};
};

template <typename Queue>
void throughput(benchmark::State& state) {
  constexpr std::int64_t kItems = 2'000'000;
  for (auto _ : state) {
    Queue queue;
    std::thread producer([&] {
      for (std::int64_t i = 0; i < kItems; ++i) {
        while (!queue.push(i)) std::this_thread::yield();
      }
    });
    std::int64_t sum = 0;
    std::int64_t value = 0;
    for (std::int64_t i = 0; i < kItems; ++i) {
      while (!queue.pop(value)) std::this_thread::yield();
      sum += value;
    }
    benchmark::DoNotOptimize(sum);
    producer.join();
  }
  state.SetItemsProcessed(state.iterations() * kItems);
}

template <typename Queue>
void wake_up(benchmark::State& state) {
  constexpr int kFrames = 400;
  std::vector<double> late_us;
  for (auto _ : state) {
    Queue queue;
    std::thread camera([&] {
      for (int i = 0; i < kFrames; ++i) {
        std::this_thread::sleep_for(std::chrono::milliseconds(5));
        queue.push(bolo::monotonic_ns());
      }
    });
    std::int64_t sent_ns = 0;
    for (int i = 0; i < kFrames; ++i) {
      if (queue.wait(sent_ns)) late_us.push_back(static_cast<double>(bolo::monotonic_ns() - sent_ns) * 1e-3);
    }
    camera.join();
  }
  std::sort(late_us.begin(), late_us.end());
  state.counters["p50_us"] = late_us[late_us.size() / 2];
  state.counters["p99_us"] = late_us[late_us.size() * 99 / 100];
}

BENCHMARK(throughput<Ours>)->UseRealTime();
BENCHMARK(throughput<Moodycamel>)->UseRealTime();
BENCHMARK(throughput<Boost>)->UseRealTime();
BENCHMARK(wake_up<Ours>)->UseRealTime()->Iterations(2);
BENCHMARK(wake_up<Moodycamel>)->UseRealTime()->Iterations(2);

}  // namespace

BENCHMARK_MAIN();

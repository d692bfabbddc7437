// Independent pieces of work on a few threads.
#pragma once

#include <atomic>
#include <functional>
#include <thread>
#include <vector>

namespace bolo::diagnose {

// Calls work(0) .. work(count - 1), each once, on at most `threads` threads. `work` must not throw.
inline void for_each_index(std::size_t count, int threads, const std::function<void(std::size_t)>& work) {
  std::atomic<std::size_t> next{0};
  const auto run = [&] {
    for (std::size_t i = next.fetch_add(1, std::memory_order_relaxed); i < count;
         i = next.fetch_add(1, std::memory_order_relaxed)) {
      work(i);
    }
  };
  std::vector<std::jthread> team;
  for (int i = 1; i < threads && static_cast<std::size_t>(i) < count; ++i) team.emplace_back(run);
  run();
}

}  // namespace bolo::diagnose

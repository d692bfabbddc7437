// Parallel loops, the main thread's stack, and error messages for memory and threads that the system refuses.
#pragma once

#include <algorithm>
#include <atomic>
#include <cstddef>
#include <exception>
#include <string>
#include <system_error>
#include <thread>
#include <vector>

#include "src/core/result.hpp"

namespace bolo {

// Calls work(i) for each i < count, started in order, on at most `threads` threads: the calling one, and as many others
// as the system grants. The first exception ends the loop and is rethrown here. Thread: any.
template <typename Work>
void share_out(std::size_t count, std::size_t threads, Work&& work) {
  std::atomic<std::size_t> next{0};
  std::atomic<bool> failed{false};
  std::exception_ptr thrown;
  const auto run = [&] {
    try {
      for (std::size_t i = next++; i < count; i = next++) work(i);
    } catch (...) {
      next = count;
      if (!failed.exchange(true)) thrown = std::current_exception();
    }
  };
  std::vector<std::jthread> team;
  try {
    while (team.size() + 1 < std::min(count, threads)) team.emplace_back(run);
  } catch (const std::system_error&) {
    // The threads that exist do all of it.
  }
  run();
  team.clear();
  if (thrown) std::rethrow_exception(thrown);
}

// Message of a library's exception; refused memory and threads get a helpful one. Thread: any.
std::string describe_exception(const std::exception& e);

// Calls step() and turns its exceptions into errors, for boundaries that no exception may cross. Thread: any.
template <typename Step>
auto tried(Step&& step) -> decltype(step()) {
  try {
    return step();
  } catch (const std::exception& e) {
    return failed(describe_exception(e));
  }
}

// False if step() threw, for lack of memory: for threads whose next step may succeed. Thread: any.
template <typename Step>
bool attempt(Step&& step) noexcept {
  try {
    step();
    return true;
  } catch (const std::exception&) {
    return false;
  }
}

// Grows the main thread's stack in advance to what deep calls may need: if a limit leaves no memory for it later, the
// kernel kills the process. Throws std::bad_alloc if there is no memory now. Thread: main, at its start.
void grow_stack();

}  // namespace bolo

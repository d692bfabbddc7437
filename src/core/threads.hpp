// Work shared out among threads, their stacks, and error messages for memory and threads that the system refuses.
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

// work(i) for each i < count, begun in order, on at most `threads` threads: the calling one, and as many others as the
// system gives. The first exception that it throws ends the work and is thrown here. Thread: any.
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
    // Those that are there do it all.
  }
  run();
  team.clear();
  if (thrown) std::rethrow_exception(thrown);
}

// Message of a library's exception; for refused memory and threads, one that helps. Thread: any.
std::string describe_exception(const std::exception& e);

// The Status or Result of step(), or of what it threw: where no exception may go further. Thread: any.
template <typename Step>
auto tried(Step&& step) -> decltype(step()) {
  try {
    return step();
  } catch (const std::exception& e) {
    return failed(describe_exception(e));
  }
}

// False where step() threw, for want of memory: a thread whose next step may make up for it goes on, and with it the
// process. Thread: any.
template <typename Step>
bool attempt(Step&& step) noexcept {
  try {
    step();
    return true;
  } catch (const std::exception&) {
    return false;
  }
}

// Grows the main thread's stack to what deep calls may need: where a limit leaves no memory for it later, the kernel
// ends the process. Throws std::bad_alloc where there is none. Thread: main, when it begins.
void grow_stack();

}  // namespace bolo

// Work shared out among threads, and error messages for memory and threads that the system refuses.
#pragma once

#include <algorithm>
#include <atomic>
#include <cstddef>
#include <exception>
#include <new>
#include <string>
#include <system_error>
#include <thread>
#include <vector>

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
inline std::string describe_exception(const std::exception& e) {
  if (dynamic_cast<const std::bad_alloc*>(&e) != nullptr) return "not enough memory";
  const auto* refused = dynamic_cast<const std::system_error*>(&e);
  if (refused == nullptr || refused->code() != std::errc::resource_unavailable_try_again) return e.what();
  return "no thread can be started: raise 'ulimit -u', or TasksMax= of the systemd unit";
}

}  // namespace bolo

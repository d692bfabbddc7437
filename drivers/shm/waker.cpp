#include "drivers/shm/waker.hpp"

#include <linux/futex.h>
#include <sys/syscall.h>
#include <unistd.h>

#include <climits>
#include <system_error>

#include "src/rt/thread.hpp"

namespace bolo::shm {
namespace {

constexpr int kAtOnce = 4;

// Wakes at most `most` waiters; returns their number.
long wake_waiting(const std::uint32_t& word, int most) noexcept {
  return syscall(SYS_futex, &word, FUTEX_WAKE, most, nullptr, nullptr, 0);
}

}  // namespace

Waker::Waker(std::uint32_t& word) : word_(word) {
  try {
    thread_ = std::thread([this] { run(); });
  } catch (const std::system_error&) {
    // No thread to be had: wake() wakes them all itself.
  }
}

Waker::~Waker() {
  if (thread_.joinable()) end();
  wake_waiting(word_, INT_MAX);
}

void Waker::end() noexcept {
  ends_.store(true, std::memory_order_relaxed);    // told by the count below
  asked_.fetch_add(1, std::memory_order_release);  // partner: run()'s load
  asked_.notify_one();
  thread_.join();
}

void Waker::wake() noexcept {
  const int at_once = thread_.joinable() ? kAtOnce : INT_MAX;
  if (wake_waiting(word_, at_once) < at_once) return;
  asked_.fetch_add(1, std::memory_order_release);  // partner: run()'s load
  asked_.notify_one();
}

void Waker::run() noexcept {
  (void)rt::apply_to_this_thread({"bolo-wake", 0});
  std::uint32_t done = 0;
  while (true) {
    asked_.wait(done, std::memory_order_acquire);
    done = asked_.load(std::memory_order_acquire);  // partner: wake(), end()
    if (ends_.load(std::memory_order_relaxed)) return;
    wake_waiting(word_, INT_MAX);
  }
}

}  // namespace bolo::shm

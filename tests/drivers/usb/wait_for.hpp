// Waiting for a condition instead of a time.
#pragma once

#include <chrono>
#include <thread>

namespace bolo::usb::testing {

// False when it has not come true for 30 s, which only guards against hanging.
template <typename Condition>
bool wait_for(Condition condition) {
  using Clock = std::chrono::steady_clock;
  const Clock::time_point limit = Clock::now() + std::chrono::seconds(30);
  while (!condition()) {
    if (Clock::now() > limit) return false;
    std::this_thread::sleep_for(std::chrono::milliseconds(2));
  }
  return true;
}

}  // namespace bolo::usb::testing

#include "src/core/clock.hpp"

#include <sys/timex.h>

#include <algorithm>
#include <array>
#include <cstdio>
#include <cstdlib>
#include <ctime>

namespace bolo {
namespace {

constexpr std::int64_t kReadEveryNs = 1'000'000'000;
constexpr int kTries = 5;  // so that at least one is not interrupted

}  // namespace

ClockState read_clock_state() noexcept {
  timex kernel{};
  if (adjtimex(&kernel) < 0 || (kernel.status & STA_UNSYNC) != 0) return {};
  const std::int64_t error_us = std::max<std::int64_t>({kernel.maxerror, kernel.esterror, 0});
  return {true, std::min(error_us * kNsPerUs, kUnboundedClockErrorNs)};
}

std::int64_t realtime_ns() noexcept {
  return std::chrono::duration_cast<std::chrono::nanoseconds>(std::chrono::system_clock::now().time_since_epoch())
      .count();
}

std::int64_t thread_cpu_ns() noexcept {
  timespec now{};
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &now);
  return static_cast<std::int64_t>(now.tv_sec) * 1'000'000'000 + now.tv_nsec;
}

std::string utc_text(std::int64_t utc_ns) {
  const std::int64_t ms = utc_ns / kNsPerMs - (utc_ns % kNsPerMs < 0 ? 1 : 0);
  const std::int64_t part = (ms % 1000 + 1000) % 1000;
  const std::time_t whole = (ms - part) / 1000;
  std::tm utc{};
  if (gmtime_r(&whole, &utc) == nullptr) return {};
  std::array<char, 64> date{};
  std::strftime(date.data(), date.size(), "%FT%T", &utc);
  std::array<char, 16> rest{};
  std::snprintf(rest.data(), rest.size(), ".%03dZ", static_cast<int>(part));
  return std::string(date.data()) + rest.data();
}

// Reads UTC between two reads of CLOCK_MONOTONIC; half their distance bounds the error.
UtcClock::Reading UtcClock::read() const noexcept {
  Reading best;
  for (int i = 0; i < kTries; ++i) {
    const std::int64_t before = clocks_.monotonic();
    const std::int64_t utc = clocks_.realtime();
    const std::int64_t after = clocks_.monotonic();
    const std::int64_t error_ns = (after - before) / 2 + 1;
    if (i == 0 || error_ns < best.error_ns) best = {utc - before - (after - before) / 2, error_ns};
  }
  return best;
}

bool UtcClock::update(std::int64_t now_ns) noexcept {
  const bool seems_same = std::abs(clocks_.realtime() - now_ns - offset_ns_) < kClockStepNs;
  if (started_ && seems_same && now_ns - read_ns_ < kReadEveryNs) return false;
  const Reading now = read();
  state_ = clocks_.state();
  read_ns_ = now_ns;
  const std::int64_t change_ns = std::abs(now.offset_ns - offset_ns_);
  const bool stepped = started_ && change_ns > kClockStepNs;
  if (!started_ || change_ns > now.error_ns + error_ns_) {
    offset_ns_ = now.offset_ns;
    error_ns_ = now.error_ns;
  }
  started_ = true;
  return stepped;
}

}  // namespace bolo

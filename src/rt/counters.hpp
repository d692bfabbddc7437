// Statistics that one thread writes and any thread reads, without locks.
#pragma once

#include <array>
#include <atomic>
#include <bit>
#include <cstddef>
#include <cstdint>
#include <span>

#include "src/core/loss.hpp"

namespace bolo::rt {

// Relaxed on purpose: each counter is independent and publishes nothing else. Thread: any.
class Counter {
 public:
  void add(std::uint64_t n = 1) noexcept { value_.fetch_add(n, std::memory_order_relaxed); }
  void take_back() noexcept { value_.fetch_sub(1, std::memory_order_relaxed); }
  std::uint64_t value() const noexcept { return value_.load(std::memory_order_relaxed); }

 private:
  std::atomic<std::uint64_t> value_{0};
};

// A value that is replaced; relaxed for the same reason as Counter. Thread: any.
template <typename T>
class Gauge {
 public:
  Gauge() = default;
  explicit Gauge(T value) noexcept : value_(value) {}
  void set(T value) noexcept { value_.store(value, std::memory_order_relaxed); }
  T value() const noexcept { return value_.load(std::memory_order_relaxed); }

 private:
  std::atomic<T> value_{};
};

// Frames lost, by cause. Thread: any.
class LossCounters {
 public:
  void add(LossCause cause, std::uint64_t n = 1) noexcept { by_cause_[static_cast<std::size_t>(cause)].add(n); }
  std::uint64_t value(LossCause cause) const noexcept { return by_cause_[static_cast<std::size_t>(cause)].value(); }
  std::uint64_t total() const noexcept {
    std::uint64_t sum = 0;
    for (const Counter& c : by_cause_) sum += c.value();
    return sum;
  }

 private:
  std::array<Counter, kLossCauses> by_cause_;
};

// Latency histogram with 8 buckets an octave: a percentile read from it is at most 12.5 % (or 1 us) above the true one.
// Bucket b < 8 holds b microseconds; bucket 8 * e + m holds [(8 + m) << (e - 1), (9 + m) << (e - 1)) microseconds.
// The same buckets are laid out in shared memory (shm_layout.h). Thread: one writer, any reader.
class LatencyHistogram {
 public:
  static constexpr std::size_t kBuckets = 192;  // up to about 2^26 us, 67 s; the last bucket takes the rest

  static constexpr std::size_t bucket(std::int64_t ns) noexcept {
    const std::uint64_t us = ns > 0 ? static_cast<std::uint64_t>(ns) / 1000 : 0;
    if (us < 8) return static_cast<std::size_t>(us);
    const auto shift = static_cast<std::size_t>(std::bit_width(us)) - 4;
    const std::size_t b = 8 * (shift + 1) + ((us >> shift) & 7);
    return b < kBuckets ? b : kBuckets - 1;
  }

  // Upper edge of a bucket, ms: reported as the percentile.
  static constexpr double upper_ms(std::size_t b) noexcept {
    if (b < 8) return static_cast<double>(b + 1) * 1e-3;
    return static_cast<double>((9 + b % 8) << (b / 8 - 1)) * 1e-3;
  }

  // Latency, ms, that `fraction` (0..1) of the counted frames did not exceed, from a copy of the counts as in shared
  // memory; 0 when nothing was counted. Thread: any.
  static constexpr double percentile_ms(std::span<const std::uint64_t> counts, double fraction) noexcept {
    std::uint64_t total = 0;
    for (const std::uint64_t c : counts) total += c;
    std::uint64_t seen = 0;
    for (std::size_t b = 0; b < counts.size(); ++b) {
      seen += counts[b];
      if (seen > 0 && static_cast<double>(seen) >= fraction * static_cast<double>(total)) return upper_ms(b);
    }
    return 0.0;
  }

  void add(std::int64_t ns) noexcept {
    counts_[bucket(ns)].add();
    sum_ns_.add(ns > 0 ? static_cast<std::uint64_t>(ns) : 0);
  }
  std::uint64_t sum_ns() const noexcept { return sum_ns_.value(); }
  std::uint64_t count(std::size_t b) const noexcept { return counts_[b].value(); }
  std::array<std::uint64_t, kBuckets> counts() const noexcept {
    std::array<std::uint64_t, kBuckets> copy{};
    for (std::size_t b = 0; b < kBuckets; ++b) copy[b] = counts_[b].value();
    return copy;
  }

 private:
  std::array<Counter, kBuckets> counts_;
  Counter sum_ns_;
};

}  // namespace bolo::rt

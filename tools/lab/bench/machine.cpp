#include "tools/lab/bench/machine.hpp"

// The same instruction sets as the pixel kernels.
#define HWY_COMPILE_ALL_ATTAINABLE
#define HWY_DISABLED_TARGETS (HWY_SSSE3 | HWY_AVX3_DL)
#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "tools/lab/bench/machine.cpp"
#include <hwy/foreach_target.h>
#include <hwy/highway.h>

HWY_BEFORE_NAMESPACE();
namespace bolo::tools::HWY_NAMESPACE {

namespace hn = hwy::HWY_NAMESPACE;

// `rounds` times twelve independent multiply-adds; returns the operations done. `sink` keeps them from being left out.
double multiply_add(int rounds, float* sink) {
  const hn::ScalableTag<float> tag;
  const auto factor = hn::Set(tag, 0.999F);
  const auto term = hn::Set(tag, 0.001F);
  auto a = hn::Set(tag, 1.0F), b = a, c = a, d = a, e = a, f = a, g = a, h = a, i = a, j = a, k = a, l = a;
  for (int round = 0; round < rounds; ++round) {
    a = hn::MulAdd(a, factor, term);
    b = hn::MulAdd(b, factor, term);
    c = hn::MulAdd(c, factor, term);
    d = hn::MulAdd(d, factor, term);
    e = hn::MulAdd(e, factor, term);
    f = hn::MulAdd(f, factor, term);
    g = hn::MulAdd(g, factor, term);
    h = hn::MulAdd(h, factor, term);
    i = hn::MulAdd(i, factor, term);
    j = hn::MulAdd(j, factor, term);
    k = hn::MulAdd(k, factor, term);
    l = hn::MulAdd(l, factor, term);
  }
  const auto sum = hn::Add(hn::Add(hn::Add(a, b), hn::Add(c, d)), hn::Add(hn::Add(e, f), hn::Add(g, h)));
  *sink += hn::GetLane(hn::Add(sum, hn::Add(hn::Add(i, j), hn::Add(k, l))));
  return 2.0 * 12.0 * rounds * static_cast<double>(hn::Lanes(tag));
}

}  // namespace bolo::tools::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
#include <algorithm>
#include <chrono>
#include <cstddef>
#include <cstdint>
#include <vector>

namespace bolo::tools {
namespace {

HWY_EXPORT(multiply_add);

constexpr int kRepeats = 12;
constexpr int kRounds = 100'000;
constexpr std::size_t kWords = std::size_t{8} << 20;  // 64 MB

template <typename Work>
double seconds_of(const Work& work) {
  const auto start = std::chrono::steady_clock::now();
  work();
  return std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
}

}  // namespace

MachinePeaks measure_peaks() {
  MachinePeaks peaks;
  const std::vector<std::uint64_t> memory(kWords, 1);
  volatile std::uint64_t kept = 0;
  float sink = 0.0F;
  for (int i = 0; i < kRepeats; ++i) {
    const double read_s = seconds_of([&] {
      std::uint64_t sum = 0;
      for (const std::uint64_t word : memory) sum += word;
      kept = sum;
    });
    peaks.read_gb_per_s = std::max(peaks.read_gb_per_s, 8e-9 * static_cast<double>(kWords) / read_s);
    double operations = 0.0;
    const double fma_s = seconds_of([&] { operations = HWY_DYNAMIC_DISPATCH(multiply_add)(kRounds, &sink); });
    peaks.fma_gflop_per_s = std::max(peaks.fma_gflop_per_s, 1e-9 * operations / fma_s);
  }
  if (sink == 0.0F) peaks.fma_gflop_per_s = 0.0;  // never: keeps the work
  return peaks;
}

}  // namespace bolo::tools
#endif

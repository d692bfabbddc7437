#include "src/deblur/correct_kernel.hpp"

#include <cstdint>
#include <vector>

// The same sets as the solvers' kernels (kernels.cpp).
#define HWY_COMPILE_ALL_ATTAINABLE
#define HWY_DISABLED_TARGETS (HWY_SSSE3 | HWY_AVX3_DL)
#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "src/deblur/correct_kernel.cpp"
#include <hwy/foreach_target.h>
#include <hwy/highway.h>

#include "src/deblur/block-inl.hpp"
#include "src/deblur/targets.hpp"

HWY_BEFORE_NAMESPACE();
namespace bolo::deblur::HWY_NAMESPACE {

HWY_INLINE Pair load_factors(const float* factors, std::size_t at, float otherwise) {
  if (factors == nullptr) return pair(otherwise);
  return {hn::LoadU(Float(), factors + at), hn::LoadU(Float(), factors + at + kLanes)};
}

HWY_INLINE Pair times(Pair x, Pair y) { return {hn::Mul(x.a, y.a), hn::Mul(x.b, y.b)}; }
HWY_INLINE Pair over(Pair x, Pair y) { return {hn::Div(x.a, y.a), hn::Div(x.b, y.b)}; }
HWY_INLINE Pair fma(Pair x, Pair y, Pair z) { return {hn::MulAdd(x.a, y.a, z.a), hn::MulAdd(x.b, y.b, z.b)}; }

// c_g = (a^g - a_0^g) / (1 - a^g)
HWY_INLINE Pair lag_over(Pair decay, const SampleStep& step) {
  Pair power = decay;
  for (int i = 1; i < step.gap; ++i) power = times(power, decay);
  return over(power - pair(step.nominal_decay), pair(1.0F) - power);
}

template <typename T>
HWY_INLINE void correct_block(const CorrectRun& run, std::size_t at, std::size_t count) {
  const Pair gain = load_factors(run.factors.gain, at, 1.0F);
  const Pair offset = load_factors(run.factors.offset, at, 0.0F);
  const Pair lag = load_factors(run.factors.lag, at, 0.0F);
  Pair before = pair(0.0F);
  Pair added = pair(0.0F);  // e
  for (const SampleStep& step : run.steps) {
    const Pair raw = load_pixels<T>(run.planes[step.slot], run.first + at, count);
    const Pair value = fma(gain, raw, offset);
    if (run.factors.lag != nullptr && step.gap > 0) {
      const Pair c = step.gap == 1 ? lag : lag_over(load_factors(run.factors.decay, at, 0.0F), step);
      added = fma(all(step.nominal_decay), added, times(c, value - before));
    }
    before = value;
    store(value + added, run.out + static_cast<std::size_t>(step.slot) * run.stride + at);
  }
}

template <typename T>
HWY_INLINE void correct_run(const CorrectRun& run) {
  static_assert(kCorrectLanes % kBlock == 0);
  for (std::size_t at = 0; at < run.count; at += kBlock) correct_block<T>(run, at, std::min(kBlock, run.count - at));
}

void correct(const CorrectRun& run) noexcept {
  run.type == PixelType::kUint16 ? correct_run<std::uint16_t>(run) : correct_run<float>(run);
}

NamedCorrect named_correct() { return {HWY_TARGET == HWY_SCALAR ? "scalar" : hwy::TargetName(HWY_TARGET), correct}; }

}  // namespace bolo::deblur::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace bolo::deblur {
namespace {

HWY_EXPORT(named_correct);

std::vector<NamedCorrect> find_corrections() {
  std::vector<NamedCorrect> found;
  for_each_target(HWY_TARGETS, [&] { found.push_back(HWY_DYNAMIC_DISPATCH(named_correct)()); });
  return found;
}

}  // namespace

CorrectKernel correct_kernel(std::string_view isa) {
  static const std::vector<NamedCorrect> found = find_corrections();
  for (const NamedCorrect& each : found) {
    if (each.isa == isa) return each.kernel;
  }
  return found.front().kernel;
}

}  // namespace bolo::deblur
#endif

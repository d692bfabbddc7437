// A block of neighbouring pixels as two vectors, its loads and stores. Included once for every instruction set.
#if defined(BOLO_DEBLUR_BLOCK_INL) == defined(HWY_TARGET_TOGGLE)
#ifdef BOLO_DEBLUR_BLOCK_INL
#undef BOLO_DEBLUR_BLOCK_INL
#else
#define BOLO_DEBLUR_BLOCK_INL
#endif

#include <algorithm>

#include <hwy/highway.h>

#include "src/deblur/kernels.hpp"

HWY_BEFORE_NAMESPACE();
namespace bolo::deblur::HWY_NAMESPACE {

namespace hn = hwy::HWY_NAMESPACE;
using Float = hn::ScalableTag<float>;
using Vec = hn::Vec<Float>;

inline constexpr std::size_t kLanes = hn::MaxLanes(Float());
// Two vectors side by side: an elimination of the interior point depends on the one before, so that a single vector
// would leave the processor idle half of the time.
inline constexpr std::size_t kBlock = 2 * kLanes;

// Memory of one block: a row of kBlock floats for each bin or sample.
using Row = float[kBlock];

struct Pair {
  Vec a;
  Vec b;
};

HWY_INLINE Vec all(float value) { return hn::Set(Float(), value); }
HWY_INLINE Pair pair(float value) { return {all(value), all(value)}; }
HWY_INLINE Pair load(const float* from) { return {hn::Load(Float(), from), hn::Load(Float(), from + kLanes)}; }
HWY_INLINE void store(Pair x, float* to) {
  hn::Store(x.a, Float(), to);
  hn::Store(x.b, Float(), to + kLanes);
}
HWY_INLINE Pair operator+(Pair x, Pair y) { return {hn::Add(x.a, y.a), hn::Add(x.b, y.b)}; }
HWY_INLINE Pair operator-(Pair x, Pair y) { return {hn::Sub(x.a, y.a), hn::Sub(x.b, y.b)}; }
HWY_INLINE Pair operator*(Vec k, Pair x) { return {hn::Mul(k, x.a), hn::Mul(k, x.b)}; }
HWY_INLINE Pair operator*(Pair x, Pair y) { return {hn::Mul(x.a, y.a), hn::Mul(x.b, y.b)}; }
HWY_INLINE Pair operator/(Pair x, Pair y) { return {hn::Div(x.a, y.a), hn::Div(x.b, y.b)}; }
HWY_INLINE Pair fma(Vec k, Pair x, Pair y) { return {hn::MulAdd(k, x.a, y.a), hn::MulAdd(k, x.b, y.b)}; }
HWY_INLINE Pair fnma(Vec k, Pair x, Pair y) { return {hn::NegMulAdd(k, x.a, y.a), hn::NegMulAdd(k, x.b, y.b)}; }
HWY_INLINE Vec fma(Vec k, Vec x, Vec y) { return hn::MulAdd(k, x, y); }
HWY_INLINE Vec fnma(Vec k, Vec x, Vec y) { return hn::NegMulAdd(k, x, y); }
// Unnormalised Haar step: sum and difference; its own inverse up to a factor of 2.
HWY_INLINE void butterfly(Pair& x, Pair& y) {
  const Pair sum = x + y;
  y = x - y;
  x = sum;
}
HWY_INLINE void butterfly(Vec& x, Vec& y) {
  const Vec sum = hn::Add(x, y);
  y = hn::Sub(x, y);
  x = sum;
}
HWY_INLINE Pair clip(Pair x, Pair limit) {
  return {hn::Min(hn::Max(x.a, hn::Neg(limit.a)), limit.a), hn::Min(hn::Max(x.b, hn::Neg(limit.b)), limit.b)};
}

HWY_INLINE Pair clip(Pair x, Vec low, Vec high) {
  return {hn::Min(hn::Max(x.a, low), high), hn::Min(hn::Max(x.b, low), high)};
}

HWY_INLINE Vec widen(const std::uint16_t* from) {
  const hn::Rebind<std::uint16_t, Float> half;
  const hn::Rebind<std::int32_t, Float> whole;
  return hn::ConvertTo(Float(), hn::PromoteTo(whole, hn::LoadU(half, from)));
}

// Rounded and clamped to uint16; NaN becomes 0.
HWY_INLINE void narrow(Vec x, std::uint16_t* to) {
  const hn::Rebind<std::uint16_t, Float> half;
  const Vec number = hn::IfThenElseZero(hn::Eq(x, x), x);
  const Vec limited = hn::Min(hn::Max(number, hn::Zero(Float())), all(65535.0F));
  hn::StoreU(hn::DemoteTo(half, hn::NearestInt(limited)), half, to);
}

HWY_INLINE Vec load_vector_of(const std::uint16_t* from) { return widen(from); }
HWY_INLINE Vec load_vector_of(const float* from) { return hn::LoadU(Float(), from); }

template <typename T>
HWY_INLINE void load_values(const T* from, Vec& to) {
  to = load_vector_of(from);
}
template <typename T>
HWY_INLINE void load_values(const T* from, Pair& to) {
  to = {load_vector_of(from), load_vector_of(from + kLanes)};
}

HWY_INLINE void store_vector(Vec x, std::uint16_t* to) { narrow(x, to); }
HWY_INLINE void store_vector(Vec x, float* to) { hn::StoreU(x, Float(), to); }

// `count` values of a plane from pixel `at`, the rest of the vector zero.
template <typename T>
HWY_INLINE Vec load_lanes(const void* plane, std::size_t at, std::size_t count) {
  const T* from = static_cast<const T*>(plane) + at;
  if (HWY_LIKELY(count == kLanes)) return load_vector_of(from);
  HWY_ALIGN T padded[kLanes] = {};
  std::copy_n(from, std::min(count, kLanes), padded);  // gives GCC the bound
  return load_vector_of(padded);
}

template <typename T>
HWY_INLINE Pair load_pixels(const void* plane, std::size_t at, std::size_t count) {
  const std::size_t first = std::min(count, kLanes);
  return {load_lanes<T>(plane, at, first), load_lanes<T>(plane, at + first, count - first)};
}

HWY_INLINE Pair load_pixels(const PixelRun& run, int slot, std::size_t at, std::size_t count) {
  const void* plane = run.planes[slot];
  return run.input == PixelType::kUint16 ? load_pixels<std::uint16_t>(plane, at, count)
                                         : load_pixels<float>(plane, at, count);
}

// lambda_half of the block's pixels; `common` for a run without its own.
HWY_INLINE Pair load_lambda(const PixelRun& run, float common, std::size_t at, std::size_t count) {
  return run.lambda == nullptr ? pair(common) : load_pixels<float>(run.lambda, at, count);
}

template <typename T>
HWY_INLINE void store_values(const PixelRun& run, Vec x, T* to) {
  store_vector(std::is_same_v<T, float> ? hn::MulAdd(all(run.scale), x, all(run.offset)) : x, to);
}

template <typename T>
HWY_INLINE void store_lanes(const PixelRun& run, Vec x, std::size_t at, std::size_t count) {
  T* const to = static_cast<T*>(run.out) + at;
  if (HWY_LIKELY(count == kLanes)) return store_values(run, x, to);
  HWY_ALIGN T values[kLanes];
  store_values(run, x, values);
  std::copy_n(values, std::min(count, kLanes), to);
}

HWY_INLINE void store_lanes(const PixelRun& run, Vec x, std::size_t at, std::size_t count) {
  run.output == PixelType::kUint16 ? store_lanes<std::uint16_t>(run, x, at, count)
                                   : store_lanes<float>(run, x, at, count);
}

HWY_INLINE void store_pixels(const PixelRun& run, Pair x, std::size_t at, std::size_t count) {
  const std::size_t first = std::min(count, kLanes);
  store_lanes(run, x.a, at, first);
  store_lanes(run, x.b, at + first, count - first);
}

template <typename Solve>
HWY_INLINE void for_each_block(const PixelRun& run, const Solve& solve) {
  for (std::size_t at = run.begin; at < run.end; at += kBlock) solve(at, std::min(kBlock, run.end - at));
}

}  // namespace bolo::deblur::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();
#endif

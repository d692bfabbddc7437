// The sweeps' updates in int16 (dual_fixed.cpp: units, overflow). Included once for every instruction set.
#if defined(BOLO_DEBLUR_DUAL_FIXED_INL) == defined(HWY_TARGET_TOGGLE)
#ifdef BOLO_DEBLUR_DUAL_FIXED_INL
#undef BOLO_DEBLUR_DUAL_FIXED_INL
#else
#define BOLO_DEBLUR_DUAL_FIXED_INL
#endif

#include "src/deblur/dual_state-inl.hpp"

HWY_BEFORE_NAMESPACE();
namespace bolo::deblur::HWY_NAMESPACE {

#if HWY_TARGET == HWY_SCALAR
using Short = float;  // without vectors int16 gains nothing
#else
using Short = std::int16_t;
using ShortVec = hn::Vec<hn::ScalableTag<Short> >;

template <int kBins, std::size_t kPixels>
struct Limits<kBins, kPixels, Short> {
  HWY_ALIGN float unit[kPixels];     // of each pixel's t
  HWY_ALIGN float inverse[kPixels];  // 1 / unit
};

template <int kBins>
HWY_INLINE void set_bounds(const DualPlan& plan, std::size_t v, Vec lambda, Dual<kBins, Short>& m) {
  const Vec unit = hn::Max(hn::Mul(all(plan.fixed.unit), lambda), all(kSmallestUnit));
  put(unit, m.unit + v);
  put(hn::Div(all(1.0F), unit), m.inverse + v);
}

// Two vectors of floats, rounded and clamped, are interleaved into one of int16.
template <int kBins>
HWY_INLINE void put_c(const DualPlan& plan, int i, std::size_t v, Pair c, Dual<kBins, Short>& m) {
  constexpr float kRounds = 0x1.8p23F;  // from here on a float's last bit has the value 1
  const hn::ScalableTag<std::int32_t> whole;
  const hn::ScalableTag<Short> half;
  const Vec weight = all(plan.row[static_cast<std::size_t>(i)].right);
  const Pair x =
      clip(fma(weight, c * load(m.inverse + v), pair(kRounds)), all(kRounds - 32767.0F), all(kRounds + 32767.0F));
  const auto b = hn::ShiftLeft<16>(hn::BitCast(whole, x.b));
  put(hn::OddEven(hn::BitCast(half, b), hn::BitCast(half, x.a)), m.c[i] + v);
}

HWY_INLINE Pair unpack(ShortVec x) {
  const auto both = hn::BitCast(hn::ScalableTag<std::int32_t>(), x);
  return {hn::ConvertTo(Float(), hn::ShiftRight<16>(hn::ShiftLeft<16>(both))),
          hn::ConvertTo(Float(), hn::ShiftRight<16>(both))};
}

struct ShortWeights {
  ShortVec keep;
  ShortVec pull;
  ShortVec begin;
  ShortVec low;
  ShortVec high;
  bool first;  // its first jump is the one at the window's beginning

  HWY_INLINE ShortVec left(ShortVec jump) const { return first ? hn::MulFixedPoint15(begin, jump) : jump; }
};

HWY_INLINE ShortVec all_short(int value) { return hn::Set(hn::ScalableTag<Short>(), static_cast<Short>(value)); }

template <int kBins>
HWY_INLINE ShortWeights weights_of(const DualPlan& plan, int i, int /*level*/, const Dual<kBins, Short>& /*m*/) {
  const FixedPlan& fixed = plan.fixed;
  const FixedPlan::Row& row = fixed.row[static_cast<std::size_t>(i)];
  return {all_short(row.keep),   all_short(row.pull),  all_short(fixed.begin),
          all_short(-row.bound), all_short(row.bound), (i & (i - 1)) == 0};
}

template <bool kFirst, int kBins>
HWY_INLINE ShortVec move(const ShortWeights& w, int i, ShortVec pull, std::size_t v, Dual<kBins, Short>& m) {
  const ShortVec old = kFirst ? all_short(0) : at(m.t(i) + v);
  const ShortVec rest = kFirst ? pull : hn::Add(hn::MulFixedPoint15(w.keep, old), pull);
  const ShortVec next = hn::Min(hn::Max(hn::SaturatedAdd(at(m.c[i] + v), rest), w.low), w.high);
  put(next, m.t(i) + v);
  return kFirst ? next : hn::Sub(next, old);
}

template <bool kFirst, int kBins>
HWY_INLINE void move_wavelet(const ShortWeights& w, int i, std::size_t v, Dual<kBins, Short>& m, ShortVec& left,
                             ShortVec& right) {
  const ShortVec ends = hn::MulFixedPoint15(w.pull, hn::Add(w.left(left), right));
  const ShortVec moved = move<kFirst>(w, i, ends, v, m);
  left = hn::Sub(left, moved);
  right = hn::Sub(right, moved);
}

template <bool kFirst, int kBins>
HWY_INLINE void move_wavelet(const ShortWeights& w, int i, std::size_t v, Dual<kBins, Short>& m, ShortVec& left,
                             ShortVec& middle, ShortVec& right) {
  if constexpr (kFirst) middle = all_short(0);
  const ShortVec pull = hn::Add(hn::MulFixedPoint15(w.pull, hn::Sub(w.left(left), middle)),
                                hn::MulFixedPoint15(w.pull, hn::Sub(right, middle)));
  const ShortVec moved = move<kFirst>(w, i, pull, v, m);
  left = hn::Sub(left, moved);
  middle = hn::Add(middle, hn::Add(moved, moved));
  right = hn::Sub(right, moved);
}

template <bool kFirst, int kBins>
HWY_INLINE void move_sum(const ShortWeights& w, std::size_t v, Dual<kBins, Short>& m, ShortVec& begin, ShortVec& end) {
  const ShortVec pull = hn::MulFixedPoint15(w.pull, hn::Sub(w.left(begin), end));
  const ShortVec moved = move<kFirst>(w, 0, pull, v, m);
  begin = hn::Sub(begin, moved);
  end = hn::Add(end, moved);
}

template <int kBins>
HWY_INLINE void finish_dual(const DualRun& run, std::size_t first, const Dual<kBins, Short>& m) {
  const std::size_t terms = run.estimate.terms;
  const Short* row[kMostTerms];
  for (std::size_t k = 0; k < terms; ++k) row[k] = m.state[run.estimate.term[k].row];
  for (std::size_t v = 0; v < m.end; v += kBlock) {
    Pair sum = pair(0.0F);
    for (std::size_t k = 0; k < terms; ++k) sum = fma(at(run.term[k]), unpack(at(row[k] + v)), sum);
    const Pair x = load(m.unit + v) * sum + load(m.estimate + v);
    store_pixels(run.pixels, x, first + v, std::min(kBlock, run.pixels.end - first - v));
  }
}
#endif

}  // namespace bolo::deblur::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();
#endif

// What the sweeps on the dual work in (dual-inl.hpp): the memory of a few vectors of pixels, and how it is loaded.
// Included once for every instruction set.
//
//   c_i        transform of p times the inverse filter's x
//   t_i        dual variable of Haar coefficient i, times p / gain_i
//   v          H^T of the dual
//   jump[j]    p c (v_{2j-1} - v_{2j}), the jump at the begin of bin 2j; the first and the last are those at the
//              window's ends. A jump between two bins of a pair moves with its wavelet alone and is not kept.
#if defined(BOLO_DEBLUR_DUAL_STATE_INL) == defined(HWY_TARGET_TOGGLE)
#ifdef BOLO_DEBLUR_DUAL_STATE_INL
#undef BOLO_DEBLUR_DUAL_STATE_INL
#else
#define BOLO_DEBLUR_DUAL_STATE_INL
#endif

#include "src/deblur/block-inl.hpp"

HWY_BEFORE_NAMESPACE();
namespace bolo::deblur::HWY_NAMESPACE {

// Vectors that are solved side by side, so that the processor always finds one that does not wait for its own results;
// fewer where their memory would leave the first cache.
constexpr std::size_t vectors_of(int bins) {
  const std::size_t most = kLanes >= 16 ? 4 : 8;
  return bins > 32 ? most / 4 : bins > 16 ? most / 2 : most;
}

constexpr std::size_t state_rows(int bins) { return static_cast<std::size_t>(bins + bins / 2 + 1); }
constexpr int log2_of(int n) { return n <= 1 ? 0 : 1 + log2_of(n / 2); }

// Memory of vectors_of(kBins) vectors of pixels.
template <int kBins>
struct Dual {
  static constexpr std::size_t kPixels = vectors_of(kBins) * kLanes;
  static constexpr std::size_t kBounds = 2 * log2_of(kBins) + 1;
  using Wide = float[kPixels];

  HWY_ALIGN Wide state[state_rows(kBins)];  // t, then the jumps
  HWY_ALIGN Wide c[std::size_t{kBins}];
  HWY_ALIGN Wide low[kBounds];
  HWY_ALIGN Wide high[kBounds];
  HWY_ALIGN Wide estimate;  // what the samples alone make of it
  std::size_t end = 0;      // of the pixels in use, whole vectors

  HWY_INLINE float* t(int i) { return state[i]; }
  HWY_INLINE float* jump(int bin) { return state[kBins + bin / 2]; }
};

HWY_INLINE Vec at(const float* from) { return hn::Load(Float(), from); }
HWY_INLINE void put(Vec x, float* to) { hn::Store(x, Float(), to); }
HWY_INLINE Vec clip(Vec x, const float* low, const float* high) { return hn::Min(hn::Max(x, at(low)), at(high)); }

// A run with what all its pixels share.
struct DualRun {
  const DualPlan& plan;
  const PixelRun& pixels;
  const Estimate& estimate;
  HWY_ALIGN float weight[kMaxSlots][kLanes];  // of each sample in the estimate
  HWY_ALIGN float term[kMostTerms][kLanes];   // and of the state's rows
  float lost[std::size_t{kMostLost}];         // what the estimate moves by with each lost sample

  // Whether one of those that move together is beside what sweep_near() sweeps.
  bool near(const LostMove& move) const {
    const auto beside = [&](std::size_t k) {
      const int slot = plan.gap[k].slot;
      return slot >= pixels.published.before / 4 * 4 - 1 && slot <= pixels.published.after / 4 * 4 + 4;
    };
    return beside(move.first) || beside(move.second);
  }

  DualRun(const DualPlan& the_plan, const PixelRun& run, const Estimate& the_estimate)
      : plan(the_plan), pixels(run), estimate(the_estimate) {
    for (std::size_t s = 0; s <= static_cast<std::size_t>(plan.bins); ++s) {
      put(all(estimate.sample[s]), weight[s]);
    }
    for (std::size_t k = 0; k < estimate.terms; ++k) put(all(estimate.term[k].weight), term[k]);
    for (std::size_t k = 0; k < plan.lost; ++k) {
      lost[k] = 0.0F;
      for (std::size_t n = 0; n < plan.lost; ++n) {
        lost[k] += plan.gap[k].along[n] * estimate.sample[static_cast<std::size_t>(plan.gap[n].slot)];
      }
    }
  }
};

template <int kBins>
HWY_INLINE void set_bounds(const DualPlan& plan, std::size_t v, Vec lambda, Dual<kBins>& m) {
  for (std::size_t i = 0; i < Dual<kBins>::kBounds; ++i) {
    const Vec bound = hn::Mul(all(plan.bound[i]), lambda);
    put(bound, m.high[i] + v);
    put(hn::Neg(bound), m.low[i] + v);
  }
}

// Four neighbouring bins' transform; returns their sum.
HWY_INLINE Vec transform_near(Vec a, Vec b, Vec c, Vec d, std::size_t row, float* at_row) {
  butterfly(a, b);
  butterfly(c, d);
  butterfly(a, c);
  put(b, at_row + row);
  put(c, at_row + 2 * row);
  put(d, at_row + 3 * row);
  return a;
}

// c, the mean, and the samples' part of the estimate, of a vector of pixels that begins at `pixel` of the planes.
template <typename T, int kBins>
HWY_INLINE void load_vector(const DualRun& run, const T* const* planes, std::size_t pixel, std::size_t v,
                            Dual<kBins>& m) {
  constexpr int kSums = kBins < 4 ? 1 : kBins / 4;
  constexpr std::size_t kRow = Dual<kBins>::kPixels;
  const DualPlan& plan = run.plan;
  const Vec decay = all(plan.decay);
  Vec y = load_vector_of(planes[0] + pixel);
  const Vec first = y;
  Vec estimate = hn::Mul(at(run.weight[0]), y);
  const auto next = [&](int slot) HWY_ATTR {
    const Vec before = y;
    y = load_vector_of(planes[slot] + pixel);
    estimate = hn::MulAdd(at(run.weight[slot]), y, estimate);
    return hn::NegMulAdd(decay, before, y);
  };
  Vec sums[std::size_t{kSums}];
  if constexpr (kBins == 2) {
    sums[0] = next(1);
    Vec x = next(2);
    butterfly(sums[0], x);
    put(x, m.c[1] + v);
  } else {
    HWY_UNROLL(16) for (int n = 0; n < kSums; ++n) {
      const Vec x0 = next(4 * n + 1);
      const Vec x1 = next(4 * n + 2);
      const Vec x2 = next(4 * n + 3);
      const Vec x3 = next(4 * n + 4);
      sums[n] = transform_near(x0, x1, x2, x3, kRow, m.c[4 * n] + v);
    }
  }
  HWY_UNROLL(4) for (int half = 1; half < kSums; half *= 2) {
    HWY_UNROLL(16) for (int k = 0; k < kSums; k += 2 * half) butterfly(sums[k], sums[k + half]);
  }
  HWY_UNROLL(16) for (int n = 1; n < kSums; ++n) put(sums[n], m.c[4 * n] + v);
  // c_0 = p sum + a last - first, so that the samples' sum is at hand.
  Vec sum = hn::Mul(all(plan.inverse_p), hn::NegMulAdd(decay, y, hn::Add(sums[0], first)));
  for (std::size_t k = 0; k < plan.lost; ++k) sum = hn::Sub(sum, load_vector_of(planes[plan.gap[k].slot] + pixel));
  const Vec mean = hn::Mul(all(plan.inverse_count), sum);
  put(hn::MulAdd(all(run.estimate.mean), mean, estimate), m.estimate + v);
  put(hn::NegMulAdd(all(plan.mean_to_sum), mean, sums[0]), m.c[0] + v);
}

// What stands in for a lost sample at first.
template <typename T>
HWY_INLINE void stand_in(const DualRun& run, const SlotValue& value, std::size_t first, std::size_t count, T* to) {
  for (std::size_t v = 0; v < count; v += kLanes) {
    const std::size_t lanes = std::min(kLanes, count - v);
    const Vec before = load_lanes<T>(run.pixels.planes[value.before], first + v, lanes);
    const Vec after = load_lanes<T>(run.pixels.planes[value.after], first + v, lanes);
    Vec between = hn::MulAdd(all(value.weight), hn::Sub(after, before), before);
    if (run.pixels.whole) {
      HWY_ALIGN std::uint16_t rounded[kLanes];
      store_vector(between, rounded);
      between = load_vector_of(rounded);
    }
    store_vector(between, to + v);
  }
}

template <typename T, int kBins>
HWY_INLINE void load_pixels(const DualRun& run, std::size_t first, std::size_t count, Dual<kBins>& m) {
  constexpr std::size_t kSlots = kBins + 1;
  const T* planes[kSlots];
  for (std::size_t s = 0; s < kSlots; ++s) planes[s] = static_cast<const T*>(run.pixels.planes[s]) + first;
  HWY_ALIGN T lost[kMostLost][Dual<kBins>::kPixels];
  for (std::size_t k = 0; k < run.plan.lost; ++k) {
    stand_in(run, run.plan.gap[k].value, first, count, lost[k]);
    planes[run.plan.gap[k].slot] = lost[k];
  }
  for (m.end = 0; m.end + kLanes <= count; m.end += kLanes) load_vector(run, planes, m.end, m.end, m);
  if (m.end == count) return;
  HWY_ALIGN T padded[kSlots][kLanes] = {};
  for (std::size_t s = 0; s < kSlots; ++s) {
    std::copy_n(planes[s] + m.end, count - m.end, padded[s]);
    planes[s] = padded[s];
  }
  load_vector(run, planes, 0, m.end, m);
  m.end += kLanes;
}

// The vectors of up to kPixels pixels that begin at `first`.
template <int kBins>
HWY_NOINLINE void load_block(const DualRun& run, std::size_t first, Dual<kBins>& m) {
  const std::size_t count = std::min(Dual<kBins>::kPixels, run.pixels.end - first);
  if (run.pixels.input == PixelType::kUint16) {
    load_pixels<std::uint16_t>(run, first, count, m);
  } else {
    load_pixels<float>(run, first, count, m);
  }
  if (run.pixels.lambda == nullptr) return;
  for (std::size_t v = 0; v < m.end; v += kLanes) {
    set_bounds(run.plan, v, load_lanes<float>(run.pixels.lambda, first + v, std::min(kLanes, count - v)), m);
  }
}

}  // namespace bolo::deblur::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();
#endif

// Working memory of the sweeps (dual-inl.hpp) for a few vectors of pixels. Included once for every instruction set.
//
//   c_i        transform of p times the inverse filter's x
//   t_i        dual variable of Haar coefficient i, times p / gain_i
//   v          H^T of the dual
//   jump[j]    p c (v_{2j-1} - v_{2j}), the jump at the beginning of bin 2j; the first and the last are those at the
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

// Vectors that are solved side by side to hide latency; fewer where their memory would not fit the L1 cache.
constexpr std::size_t vectors_of(int bins) {
  const std::size_t most = kLanes >= 16 ? 4 : 8;
  return bins > 32 ? most / 4 : bins > 16 ? most / 2 : most;
}

constexpr std::size_t state_rows(int bins) { return static_cast<std::size_t>(bins + bins / 2 + 1); }
constexpr int log2_of(int n) { return n <= 1 ? 0 : 1 + log2_of(n / 2); }

// Bounds of t, by pixel.
template <int kBins, std::size_t kPixels, typename T>
struct Limits {
  static constexpr std::size_t kBounds = 2 * log2_of(kBins) + 1;
  HWY_ALIGN float low[kBounds][kPixels];
  HWY_ALIGN float high[kBounds][kPixels];
};

// Memory of vectors_of(kBins) vectors of pixels, solved in T.
template <int kBins, typename T = float>
struct Dual : Limits<kBins, vectors_of(kBins) * hn::MaxLanes(hn::ScalableTag<T>()), T> {
  static constexpr std::size_t kStep = hn::MaxLanes(hn::ScalableTag<T>());
  static constexpr std::size_t kPixels = vectors_of(kBins) * kStep;
  using Wide = T[kPixels];
  using Loaded = std::conditional_t<std::is_same_v<T, float>, Vec, Pair>;  // pixels that are loaded at once
  static constexpr std::size_t kLoaded = sizeof(Loaded) / sizeof(float);

  HWY_ALIGN Wide state[state_rows(kBins)];  // t, then the jumps
  HWY_ALIGN Wide c[std::size_t{kBins}];
  HWY_ALIGN float estimate[kPixels];  // the samples' part
  std::size_t end = 0;                // of the pixels in use, in whole vectors

  HWY_INLINE T* t(int i) { return state[i]; }
  HWY_INLINE T* jump(int bin) { return state[kBins + bin / 2]; }
};

template <typename T>
HWY_INLINE auto at(const T* from) {
  return hn::Load(hn::ScalableTag<T>(), from);
}
template <typename T>
HWY_INLINE void put(hn::Vec<hn::ScalableTag<T>> x, T* to) {
  hn::Store(x, hn::ScalableTag<T>(), to);
}
HWY_INLINE void put(Pair x, float* to) { store(x, to); }
HWY_INLINE Vec clip(Vec x, const float* low, const float* high) { return hn::Min(hn::Max(x, at(low)), at(high)); }

// A run and the constants that its pixels share.
struct DualRun {
  const DualPlan& plan;
  const PixelRun& pixels;
  const Estimate& estimate;
  HWY_ALIGN float weight[kMaxSlots][kLanes];  // of each sample in the estimate
  HWY_ALIGN float term[kMostTerms][kLanes];   // of the state's rows in the estimate
  float lost[std::size_t{kMostLost}];         // change of the estimate per lost sample

  // True if a sample of the move is next to the bins of sweep_near().
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
  for (std::size_t i = 0; i < m.kBounds; ++i) {
    const Vec bound = hn::Mul(all(plan.bound[i]), lambda);
    put(bound, m.high[i] + v);
    put(hn::Neg(bound), m.low[i] + v);
  }
}

template <int kBins>
HWY_INLINE void put_c(const DualPlan& /*plan*/, int i, std::size_t v, Vec c, Dual<kBins>& m) {
  put(c, m.c[i] + v);
}

// Transform of four neighbouring bins; returns their sum.
template <typename V, typename Put>
HWY_INLINE V transform_near(V a, V b, V c, V d, int i, const Put& put_at) {
  butterfly(a, b);
  butterfly(c, d);
  butterfly(a, c);
  put_at(i + 1, b);
  put_at(i + 2, c);
  put_at(i + 3, d);
  return a;
}

// Loads c, the mean and the samples' part of the estimate for the pixels of one load, from `pixel` on.
template <typename P, int kBins, typename T>
HWY_INLINE void load_vector(const DualRun& run, const P* const* planes, std::size_t pixel, std::size_t v,
                            Dual<kBins, T>& m) {
  using V = typename Dual<kBins, T>::Loaded;
  constexpr int kSums = kBins < 4 ? 1 : kBins / 4;
  constexpr bool kEstimates = std::is_same_v<T, float>;  // of all samples, for admm; else of dual's few
  const DualPlan& plan = run.plan;
  const Vec decay = all(plan.decay);
  V y;
  load_values(planes[0] + pixel, y);
  const V first = y;
  V estimate = at(run.weight[0]) * y;
  const auto next = [&](int slot) HWY_ATTR {
    const V before = y;
    load_values(planes[slot] + pixel, y);
    if constexpr (kEstimates) estimate = fma(at(run.weight[slot]), y, estimate);
    return fnma(decay, before, y);
  };
  const auto put_at = [&](int i, V c) HWY_ATTR { put_c(plan, i, v, c, m); };
  V sums[std::size_t{kSums}];
  if constexpr (kBins == 2) {
    sums[0] = next(1);
    V x = next(2);
    butterfly(sums[0], x);
    put_at(1, x);
  } else {
    HWY_UNROLL(16) for (int n = 0; n < kSums; ++n) {
      const V x0 = next(4 * n + 1);
      const V x1 = next(4 * n + 2);
      const V x2 = next(4 * n + 3);
      const V x3 = next(4 * n + 4);
      sums[n] = transform_near(x0, x1, x2, x3, 4 * n, put_at);
    }
  }
  HWY_UNROLL(4) for (int half = 1; half < kSums; half *= 2) {
    HWY_UNROLL(16) for (int k = 0; k < kSums; k += 2 * half) butterfly(sums[k], sums[k + half]);
  }
  HWY_UNROLL(16) for (int n = 1; n < kSums; ++n) put_at(4 * n, sums[n]);
  // c_0 = p sum + a last - first: gives the samples' sum without another pass.
  V sum = all(plan.inverse_p) * fnma(decay, y, sums[0] + first);
  for (std::size_t k = 0; k < plan.lost; ++k) {
    load_values(planes[plan.gap[k].slot] + pixel, y);
    sum = sum - y;
  }
  const V mean = all(plan.inverse_count) * sum;
  if constexpr (kEstimates) {
    put(fma(all(run.estimate.mean), mean, estimate), m.estimate + v);
  } else {
    estimate = all(run.estimate.mean) * mean;
    for (int slot = run.pixels.published.before; slot <= run.pixels.published.after + 1; ++slot) {
      load_values(planes[slot] + pixel, y);
      estimate = fma(at(run.weight[slot]), y, estimate);
    }
    put(estimate, m.estimate + v);
  }
  put_at(0, fnma(all(plan.mean_to_sum), mean, sums[0]));
}

// Writes the initial value of a lost sample.
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

template <typename P, int kBins, typename T>
HWY_INLINE void load_pixels(const DualRun& run, std::size_t first, std::size_t count, Dual<kBins, T>& m) {
  constexpr std::size_t kSlots = kBins + 1;
  constexpr std::size_t kLoaded = Dual<kBins, T>::kLoaded;
  const P* planes[kSlots];
  for (std::size_t s = 0; s < kSlots; ++s) planes[s] = static_cast<const P*>(run.pixels.planes[s]) + first;
  HWY_ALIGN P lost[kMostLost][Dual<kBins, T>::kPixels];
  for (std::size_t k = 0; k < run.plan.lost; ++k) {
    stand_in(run, run.plan.gap[k].value, first, count, lost[k]);
    planes[run.plan.gap[k].slot] = lost[k];
  }
  for (m.end = 0; m.end + kLoaded <= count; m.end += kLoaded) load_vector(run, planes, m.end, m.end, m);
  if (m.end == count) return;
  HWY_ALIGN P padded[kSlots][kLoaded] = {};
  for (std::size_t s = 0; s < kSlots; ++s) {
    std::copy_n(planes[s] + m.end, count - m.end, padded[s]);
    planes[s] = padded[s];
  }
  load_vector(run, planes, 0, m.end, m);
  m.end += kLoaded;
}

template <int kBins, typename T>
HWY_NOINLINE void load_block(const DualRun& run, std::size_t first, Dual<kBins, T>& m) {
  const std::size_t count = std::min(Dual<kBins, T>::kPixels, run.pixels.end - first);
  for (std::size_t v = 0; run.pixels.lambda != nullptr && v < count; v += kLanes) {
    set_bounds(run.plan, v, load_lanes<float>(run.pixels.lambda, first + v, std::min(kLanes, count - v)), m);
  }
  if (run.pixels.input == PixelType::kUint16) {
    load_pixels<std::uint16_t>(run, first, count, m);
  } else {
    load_pixels<float>(run, first, count, m);
  }
}

}  // namespace bolo::deblur::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();
#endif

// Coordinate descent with over-relaxation on the dual (dual_plan.hpp). Included once for every instruction set.
//
//   t_i        dual variable of Haar coefficient i, in units of lambda and divided by sqrt(support)
//   v          H^T t
//   jump[j]    v_{j-1} - v_j, the jump at the begin of bin j; [0] and [bins] are those at the ends of the window
//   h_i        gain times the transform of the inverse filter's x
#if defined(BOLO_DEBLUR_DUAL_INL) == defined(HWY_TARGET_TOGGLE)
#ifdef BOLO_DEBLUR_DUAL_INL
#undef BOLO_DEBLUR_DUAL_INL
#else
#define BOLO_DEBLUR_DUAL_INL
#endif

#include <array>

#include "src/deblur/block-inl.hpp"

HWY_BEFORE_NAMESPACE();
namespace bolo::deblur::HWY_NAMESPACE {

// Blocks that are solved side by side, so that the processor always finds one that does not wait for its own results;
// fewer where their memory would leave the first cache.
constexpr std::size_t blocks_of(int bins) { return bins > 32 ? 1 : bins > 16 || kLanes >= 16 ? 2 : 4; }

// In the values' unit; below it the box is as good as a point.
inline constexpr float kLeastLambda = 1e-6F;

constexpr int log2_of(int n) { return n <= 1 ? 0 : 1 + log2_of(n / 2); }
constexpr std::size_t rows_of(int n) { return static_cast<std::size_t>(n); }

template <int kBins>
struct Dual {
  HWY_ALIGN Row t[rows_of(kBins)];
  HWY_ALIGN Row h[rows_of(kBins)];
  HWY_ALIGN Row jump[rows_of(kBins + 1)];
  HWY_ALIGN Row sum;     // of all samples
  HWY_ALIGN Row lambda;  // of each pixel, never 0
};

template <int kBins>
using Duals = std::array<Dual<kBins>, blocks_of(kBins)>;

HWY_INLINE void store_h(const DualPlan& plan, int i, Pair inverse_lambda, Pair c, Row* h) {
  store(all(plan.row[static_cast<std::size_t>(i)].gain) * c * inverse_lambda, h[i]);
}

// lambda, h and the sum of the samples.
template <int kBins>
HWY_INLINE void begin_dual(const DualPlan& plan, const PixelRun& run, std::size_t at, std::size_t count,
                           Dual<kBins>& m) {
  Row* const h = m.h;
  const Pair lambda = at_least(load_lambda(run, plan.lambda, at, count), kLeastLambda);
  const Pair inverse_lambda = pair(1.0F) / lambda;
  store(lambda, m.lambda);
  const Vec gain = all(plan.inverse_gain);
  Pair before = load_pixels(run, 0, at, count);
  Pair sum = before;
  constexpr int kNear = kBins < 4 ? kBins : 4;
  for (int i = 0; i < kBins; i += kNear) {
    Pair c[rows_of(kNear)];
    HWY_UNROLL(4) for (int k = 0; k < kNear; ++k) {
      const Pair y = load_pixels(run, i + k + 1, at, count);
      sum = sum + y;
      c[k] = fma(gain, y - before, y);
      before = y;
    }
    HWY_UNROLL(2) for (int half = 1; half < kNear; half *= 2) {
      HWY_UNROLL(4) for (int k = 0; k < kNear; k += 2 * half) butterfly(c[k], c[k + half]);
    }
    store(c[0], h[i]);
    HWY_UNROLL(4) for (int k = 1; k < kNear; ++k) { store_h(plan, i + k, inverse_lambda, c[k], h); }
  }
  constexpr int kSums = kBins / kNear;
  Pair c[rows_of(kSums)];
  HWY_UNROLL(16) for (int k = 0; k < kSums; ++k) c[k] = load(h[k * kNear]);
  HWY_UNROLL(4) for (int half = 1; half < kSums; half *= 2) {
    HWY_UNROLL(16) for (int k = 0; k < kSums; k += 2 * half) butterfly(c[k], c[k + half]);
  }
  const Pair mean = all(plan.inverse_count) * sum;
  c[0] = fnma(all(static_cast<float>(kBins)), mean, c[0]);
  HWY_UNROLL(16) for (int k = 0; k < kSums; ++k) { store_h(plan, k * kNear, inverse_lambda, c[k], h); }
  store(sum, m.sum);
}

// What an update needs besides the pixel's own values.
struct Weights {
  Vec keep;
  Vec bend;
  Vec twice_bend;
  Vec low;
  Vec high;
};

HWY_INLINE Weights weights_of(const DualPlan& plan, int i, int level) {
  const DualCoefficients& row = plan.row[static_cast<std::size_t>(i)];
  const float limit = plan.limit[static_cast<std::size_t>(level)];
  return {all(row.keep), all(row.bend), all(2.0F * row.bend), all(-limit), all(limit)};
}

// One coefficient; returns how far it moved. In the first sweep t and the jump in the middle are still zero.
template <bool kFirst>
HWY_INLINE Pair move(const Weights& w, const float* h, Pair ends, Pair middle, float* t) {
  const Pair old = kFirst ? pair(0.0F) : load(t);
  const Pair rest = kFirst ? load(h) : fnma(w.twice_bend, middle, fma(w.keep, old, load(h)));
  const Pair next = clip(fma(w.bend, ends, rest), w.low, w.high);
  store(next, t);
  return kFirst ? next : next - old;
}

// Moves a wavelet and the jumps at its begin, middle and end.
template <bool kFirst, bool kAtBegin>
HWY_INLINE void move_wavelet(const Weights& w, Vec begin_jump, const float* h, float* t, Pair& left, Pair& middle,
                             Pair& right) {
  const Pair moved = move<kFirst>(w, h, left + right, middle, t);
  left = kAtBegin ? fnma(begin_jump, moved, left) : left - moved;
  middle = kFirst ? moved + moved : fma(all(2.0F), moved, middle);
  right = right - moved;
}

// The wavelets of kTree neighbouring stretches of kStride bins; their jumps stay in registers.
template <int kBins, int kTree, int kStride, bool kFirst, bool kAtBegin>
HWY_INLINE void sweep_tree(const DualPlan& plan, int begin, Duals<kBins>& blocks) {
  constexpr int kLevel = log2_of(kTree * kStride) - 1;
  const Vec begin_jump = all(plan.begin_jump);
  const int middle = begin + kTree / 2 * kStride;
  const Weights coarse = weights_of(plan, middle, kLevel);
  const Weights fine = weights_of(plan, middle + (kTree == 4 ? kStride : 0), kTree == 4 ? kLevel - 1 : kLevel);
  const Weights first = kAtBegin && kTree == 4 ? weights_of(plan, middle - kStride, kLevel - 1) : fine;
  for (Dual<kBins>& m : blocks) {
    Pair jump[rows_of(kTree + 1)];
    HWY_UNROLL(5) for (int k = 0; k <= kTree; ++k) {
      if (!kFirst || k == 0 || k == kTree) jump[k] = load(m.jump[begin + k * kStride]);
    }
    move_wavelet<kFirst, kAtBegin>(coarse, begin_jump, m.h[middle], m.t[middle], jump[0], jump[kTree / 2], jump[kTree]);
    if constexpr (kTree == 4) {
      const int left = middle - kStride;
      const int right = middle + kStride;
      move_wavelet<kFirst, kAtBegin>(first, begin_jump, m.h[left], m.t[left], jump[0], jump[1], jump[2]);
      move_wavelet<kFirst, false>(fine, begin_jump, m.h[right], m.t[right], jump[2], jump[3], jump[4]);
    }
    HWY_UNROLL(5) for (int k = 0; k <= kTree; ++k) store(jump[k], m.jump[begin + k * kStride]);
  }
}

// The trees of one size over the window, every other one first: neighbours wait for each other's jumps.
template <int kBins, int kSpan, int kTree, bool kFirst>
HWY_INLINE void sweep_levels(const DualPlan& plan, Duals<kBins>& blocks) {
  constexpr int kStride = kSpan / kTree;
  sweep_tree<kBins, kTree, kStride, kFirst, true>(plan, 0, blocks);
  for (const int second : {0, kSpan}) {
    for (int begin = second == 0 ? 2 * kSpan : kSpan; begin < kBins; begin += 2 * kSpan) {
      sweep_tree<kBins, kTree, kStride, kFirst, false>(plan, begin, blocks);
    }
  }
  if constexpr (kStride > 1) sweep_levels<kBins, kStride, 4, kFirst>(plan, blocks);
}

// Only the trees that hold the bins which are published.
template <int kBins, int kSpan, int kTree>
HWY_INLINE void sweep_near_levels(const DualPlan& plan, const Published& bins, Duals<kBins>& blocks) {
  constexpr int kStride = kSpan / kTree;
  const int before = bins.before / kSpan * kSpan;
  const int after = bins.after / kSpan * kSpan;
  for (int begin = before; begin <= after; begin += kSpan) {
    if (begin == 0) {
      sweep_tree<kBins, kTree, kStride, false, true>(plan, 0, blocks);
    } else {
      sweep_tree<kBins, kTree, kStride, false, false>(plan, begin, blocks);
    }
  }
  if constexpr (kStride > 1) sweep_near_levels<kBins, kStride, 4>(plan, bins, blocks);
}

// The coefficient that is constant over the window: it has no middle.
template <int kBins, bool kFirst>
HWY_INLINE void sweep_sum(const DualPlan& plan, Duals<kBins>& blocks) {
  const Weights weights = weights_of(plan, 0, log2_of(kBins) - 1);
  const Vec begin_jump = all(plan.begin_jump);
  for (Dual<kBins>& m : blocks) {
    const Pair begin = kFirst ? pair(0.0F) : load(m.jump[0]);
    const Pair end = kFirst ? pair(0.0F) : load(m.jump[kBins]);
    const Pair moved = move<kFirst>(weights, m.h[0], begin - end, pair(0.0F), m.t[0]);
    store(fnma(begin_jump, moved, begin), m.jump[0]);
    store(end + moved, m.jump[kBins]);
  }
}

template <int kBins>
constexpr int first_tree() {
  return log2_of(kBins) % 2 == 1 ? 2 : 4;
}

template <int kBins, bool kFirst>
HWY_INLINE void sweep(const DualPlan& plan, Duals<kBins>& blocks) {
  sweep_sum<kBins, kFirst>(plan, blocks);
  sweep_levels<kBins, kBins, first_tree<kBins>(), kFirst>(plan, blocks);
}

template <int kBins>
HWY_INLINE void sweep_near(const DualPlan& plan, const Published& bins, Duals<kBins>& blocks) {
  sweep_sum<kBins, false>(plan, blocks);
  sweep_near_levels<kBins, kBins, first_tree<kBins>()>(plan, bins, blocks);
}

// v of one bin.
template <int kBins>
HWY_INLINE Pair dual_at(const Dual<kBins>& m, int bin) {
  Pair v = load(m.t[0]);
  for (int half = kBins / 2; half > 0; half /= 2) {
    const Pair t = load(m.t[(bin & ~(2 * half - 1)) + half]);
    v = (bin & half) != 0 ? v - t : v + t;
  }
  return v;
}

// x of one bin: the inverse filter's, less v + c L v.
template <int kBins>
HWY_INLINE Pair input_at(const DualPlan& plan, const PixelRun& run, std::size_t at, std::size_t count,
                         const Dual<kBins>& m, int bin) {
  const Pair before = load_pixels(run, bin, at, count);
  const Pair y = load_pixels(run, bin + 1, at, count);
  const Pair inverse = fma(all(plan.inverse_gain), y - before, y);
  const Pair bent = fma(all(plan.curvature), load(m.jump[bin + 1]) - load(m.jump[bin]), dual_at(m, bin));
  return inverse - load(m.lambda) * bent;
}

template <int kBins>
HWY_INLINE Pair estimate(const DualPlan& plan, const PixelRun& run, std::size_t at, std::size_t count,
                         const Dual<kBins>& m) {
  const Published& bins = run.published;
  // A sample that is not a number shows in the sum, not in every clipped t.
  const Pair sum = load(m.sum);
  const Pair late = fma(all(bins.weight_after), input_at(plan, run, at, count, m, bins.after), sum - sum);
  return fma(all(bins.weight_before), input_at(plan, run, at, count, m, bins.before), late);
}

template <int kBins>
void dual_run(const DualPlan& plan, const PixelRun& run) {
  constexpr std::size_t kBlocks = blocks_of(kBins);
  Duals<kBins> blocks;
  for (std::size_t first = run.begin; first < run.end; first += kBlocks * kBlock) {
    const auto at = [&](std::size_t i) { return std::min(first + i * kBlock, run.end); };
    for (std::size_t i = 0; i < kBlocks; ++i)
      begin_dual(plan, run, at(i), std::min(kBlock, run.end - at(i)), blocks[i]);
    sweep<kBins, true>(plan, blocks);
    for (int k = 1; k < plan.sweeps; ++k) sweep<kBins, false>(plan, blocks);
    for (int k = 0; k < plan.near_sweeps; ++k) sweep_near<kBins>(plan, run.published, blocks);
    for (std::size_t i = 0; i < kBlocks; ++i) {
      const std::size_t count = std::min(kBlock, run.end - at(i));
      store_pixels(run, estimate(plan, run, at(i), count, blocks[i]), at(i), count);
    }
  }
}

void solve_dual(const DualPlan& plan, const PixelRun& run) noexcept {
  switch (plan.bins) {
    case 2:
      return dual_run<2>(plan, run);
    case 4:
      return dual_run<4>(plan, run);
    case 8:
      return dual_run<8>(plan, run);
    case 16:
      return dual_run<16>(plan, run);
    case 32:
      return dual_run<32>(plan, run);
    default:
      return dual_run<64>(plan, run);
  }
}

}  // namespace bolo::deblur::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();
#endif

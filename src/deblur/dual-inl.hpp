// Coordinate descent with over-relaxation on the dual (dual_plan.hpp). Included once for every instruction set.
#if defined(BOLO_DEBLUR_DUAL_INL) == defined(HWY_TARGET_TOGGLE)
#ifdef BOLO_DEBLUR_DUAL_INL
#undef BOLO_DEBLUR_DUAL_INL
#else
#define BOLO_DEBLUR_DUAL_INL
#endif

#include "src/deblur/dual_fixed-inl.hpp"
#include "src/deblur/dual_lost-inl.hpp"

HWY_BEFORE_NAMESPACE();
namespace bolo::deblur::HWY_NAMESPACE {

struct Weights {
  Vec keep;
  Vec left;
  Vec right;
  Vec middle;
  std::size_t bound;
};

// `level`: log2 of the coefficient's support, less 1.
template <int kBins>
HWY_INLINE Weights weights_of(const DualPlan& plan, int i, int level, const Dual<kBins>& /*m*/) {
  const DualCoefficients& row = plan.row[static_cast<std::size_t>(i)];
  return {all(row.keep), all(row.left), all(row.right), all(row.middle), bound_of(i, level)};
}

// Updates one coefficient and returns its change. In the first sweep t is still zero.
template <bool kFirst, int kBins>
HWY_INLINE Vec move(const Weights& w, int i, Vec pull, std::size_t v, Dual<kBins>& m) {
  const Vec old = kFirst ? hn::Zero(Float()) : at(m.t(i) + v);
  const Vec rest = kFirst ? at(m.c[i] + v) : hn::MulAdd(w.keep, old, at(m.c[i] + v));
  const Vec next = clip(hn::Add(rest, pull), m.low[w.bound] + v, m.high[w.bound] + v);
  put(next, m.t(i) + v);
  return kFirst ? next : hn::Sub(next, old);
}

// Updates a wavelet and the jumps at its ends and, if that is kept, in its middle.
template <bool kFirst, int kBins>
HWY_INLINE void move_wavelet(const Weights& w, int i, std::size_t v, Dual<kBins>& m, Vec& left, Vec& right) {
  const Vec moved = move<kFirst>(w, i, hn::Add(left, right), v, m);
  left = hn::NegMulAdd(w.left, moved, left);
  right = hn::NegMulAdd(w.right, moved, right);
}

template <bool kFirst, int kBins>
HWY_INLINE void move_wavelet(const Weights& w, int i, std::size_t v, Dual<kBins>& m, Vec& left, Vec& middle,
                             Vec& right) {
  const Vec ends = hn::Add(left, right);
  const Vec moved = move<kFirst>(w, i, kFirst ? ends : hn::NegMulAdd(all(2.0F), middle, ends), v, m);
  left = hn::NegMulAdd(w.left, moved, left);
  middle = kFirst ? hn::Mul(w.middle, moved) : hn::MulAdd(w.middle, moved, middle);
  right = hn::NegMulAdd(w.right, moved, right);
}

template <bool kFirst, int kBins>
HWY_INLINE void move_sum(const Weights& w, std::size_t v, Dual<kBins>& m, Vec& begin, Vec& end) {
  const Vec moved = move<kFirst>(w, 0, hn::Sub(begin, end), v, m);
  begin = hn::NegMulAdd(w.left, moved, begin);
  end = hn::MulAdd(w.right, moved, end);
}

// Sweeps the wavelets of kTree neighbouring stretches of kStride bins; their jumps stay in registers.
template <int kBins, int kTree, int kStride, bool kFirst, typename T>
HWY_INLINE void sweep_tree(const DualPlan& plan, int begin, Dual<kBins, T>& m) {
  constexpr int kLevel = log2_of(kTree * kStride) - 1;
  const int middle = begin + kTree / 2 * kStride;
  T* const left_jump = m.jump(begin);
  T* const right_jump = m.jump(begin + kTree * kStride);
  const auto coarse = weights_of(plan, middle, kLevel, m);
  if constexpr (kTree == 2) {
    for (std::size_t v = 0; v < m.end; v += m.kStep) {
      auto left = at(left_jump + v);
      auto right = at(right_jump + v);
      if constexpr (kStride == 1) {
        move_wavelet<kFirst>(coarse, middle, v, m, left, right);
      } else {
        auto inner = kFirst ? left : at(m.jump(middle) + v);
        move_wavelet<kFirst>(coarse, middle, v, m, left, inner, right);
        put(inner, m.jump(middle) + v);
      }
      put(left, left_jump + v);
      put(right, right_jump + v);
    }
  } else {
    const auto near = weights_of(plan, middle - kStride, kLevel - 1, m);
    const auto far = weights_of(plan, middle + kStride, kLevel - 1, m);
    for (std::size_t v = 0; v < m.end; v += m.kStep) {
      auto left = at(left_jump + v);
      auto right = at(right_jump + v);
      auto inner = kFirst ? left : at(m.jump(middle) + v);
      move_wavelet<kFirst>(coarse, middle, v, m, left, inner, right);
      if constexpr (kStride == 1) {
        move_wavelet<kFirst>(near, middle - kStride, v, m, left, inner);
        move_wavelet<kFirst>(far, middle + kStride, v, m, inner, right);
      } else {
        T* const near_jump = m.jump(middle - kStride) + v;
        T* const far_jump = m.jump(middle + kStride) + v;
        auto near_inner = kFirst ? left : at(near_jump);
        auto far_inner = kFirst ? left : at(far_jump);
        move_wavelet<kFirst>(near, middle - kStride, v, m, left, near_inner, inner);
        move_wavelet<kFirst>(far, middle + kStride, v, m, inner, far_inner, right);
        put(near_inner, near_jump);
        put(far_inner, far_jump);
      }
      put(left, left_jump + v);
      put(inner, m.jump(middle) + v);
      put(right, right_jump + v);
    }
  }
}

// Sweeps the trees of one size over the window, every other one first, because neighbours depend on each other's jumps.
template <int kBins, int kSpan, int kTree, bool kFirst, typename T>
HWY_INLINE void sweep_levels(const DualPlan& plan, Dual<kBins, T>& m) {
  constexpr int kStride = kSpan / kTree;
  HWY_UNROLL(4)
  for (int begin = 0; begin < kBins; begin += 2 * kSpan) sweep_tree<kBins, kTree, kStride, kFirst>(plan, begin, m);
  HWY_UNROLL(4)
  for (int begin = kSpan; begin < kBins; begin += 2 * kSpan) sweep_tree<kBins, kTree, kStride, kFirst>(plan, begin, m);
  if constexpr (kStride > 1) sweep_levels<kBins, kStride, 4, kFirst>(plan, m);
}

// Sweeps only the trees that contain the published bins.
template <int kBins, int kSpan, int kTree, typename T>
HWY_INLINE void sweep_near_levels(const DualPlan& plan, const Published& bins, Dual<kBins, T>& m) {
  constexpr int kStride = kSpan / kTree;
  for (int begin = bins.before / kSpan * kSpan; begin <= bins.after; begin += kSpan) {
    sweep_tree<kBins, kTree, kStride, false>(plan, begin, m);
  }
  if constexpr (kStride > 1) sweep_near_levels<kBins, kStride, 4>(plan, bins, m);
}

// Updates the coefficient that is constant over the window: it has no middle.
template <int kBins, bool kFirst, typename T>
HWY_INLINE void sweep_sum(const DualPlan& plan, Dual<kBins, T>& m) {
  const auto w = weights_of(plan, 0, log2_of(kBins) - 1, m);
  for (std::size_t v = 0; v < m.end; v += m.kStep) {
    auto begin = kFirst ? hn::Zero(hn::ScalableTag<T>()) : at(m.jump(0) + v);
    auto end = kFirst ? begin : at(m.jump(kBins) + v);
    move_sum<kFirst>(w, v, m, begin, end);
    put(begin, m.jump(0) + v);
    put(end, m.jump(kBins) + v);
  }
}

template <int kBins>
constexpr int first_tree() {
  return log2_of(kBins) % 2 == 1 ? 2 : 4;
}

// Not inlined: otherwise it would be compiled for admm and dual separately.
template <int kBins, bool kFirst, typename T>
HWY_NOINLINE void sweep(const DualPlan& plan, Dual<kBins, T>& m) {
  sweep_sum<kBins, kFirst>(plan, m);
  sweep_levels<kBins, kBins, first_tree<kBins>(), kFirst>(plan, m);
}

template <int kBins, typename T>
HWY_NOINLINE void sweep_near(const DualPlan& plan, const Published& bins, Dual<kBins, T>& m) {
  sweep_sum<kBins, false>(plan, m);
  sweep_near_levels<kBins, kBins, first_tree<kBins>()>(plan, bins, m);
}

// Moves lost samples before sweep `next`, counted from 0, or after the last (kLast), then only those of pairs, which no
// sweep sets; before the first sweep these are right. Samples out of sweep_near()'s reach have converged before it.
template <int kBins>
HWY_NOINLINE void balance(const DualRun& run, int next, Dual<kBins>& m) {
  const DualPlan& plan = run.plan;
  const auto reached = [&](std::size_t k) HWY_ATTR { return next < plan.sweeps || run.near(plan.move[k]); };
  std::size_t pairs = 0;
  for (; pairs < plan.moves && plan.gap[plan.move[pairs].first].pair; ++pairs) {
    if (next > 0 && reached(pairs)) solve_pair(run, plan.move[pairs], m);
  }
  const int rounds = next == kLast ? 0 : plan.rounds;
  for (int round = 0; round < rounds; ++round) {
    for (std::size_t k = pairs; k < plan.moves; ++k) {
      if (!reached(k)) continue;
      const LostMove& lost = plan.move[k];
      if (lost.first == lost.second) {
        solve_lost<false>(run, lost, next, m);
      } else {
        solve_lost<true>(run, lost, next, m);
      }
    }
  }
}

template <int kBins>
HWY_INLINE void finish_dual(const DualRun& run, std::size_t first, const Dual<kBins>& m) {
  const std::size_t terms = run.estimate.terms;
  const float* row[kMostTerms];
  for (std::size_t k = 0; k < terms; ++k) row[k] = m.state[run.estimate.term[k].row];
  for (std::size_t v = 0; v < m.end; v += kLanes) {
    Vec x = at(m.estimate + v);
    for (std::size_t k = 0; k < terms; ++k) x = hn::MulAdd(at(run.term[k]), at(row[k] + v), x);
    store_lanes(run.pixels, x, first + v, std::min(kLanes, run.pixels.end - first - v));
  }
}

// Calls finish(first pixel, memory) for each part of the run once its dual is near the optimum.
template <int kBins, typename T = float, typename Finish>
HWY_INLINE void for_each_dual(const DualRun& run, const Finish& finish) {
  Dual<kBins, T> m{};
  if (run.pixels.lambda == nullptr) {
    for (std::size_t v = 0; v < m.kPixels; v += kLanes) set_bounds(run.plan, v, all(run.plan.lambda), m);
  }
  const auto move_lost = [&](int next) HWY_ATTR {
    if constexpr (std::is_same_v<T, float>) balance(run, next, m);
  };
  for (std::size_t first = run.pixels.begin; first < run.pixels.end; first += m.kPixels) {
    load_block(run, first, m);
    for (int k = 0; k < run.plan.sweeps + run.plan.near_sweeps; ++k) {
      if (k >= run.plan.first_balance) move_lost(k);
      if (k == 0) {
        sweep<kBins, true>(run.plan, m);
      } else if (k < run.plan.sweeps) {
        sweep<kBins, false>(run.plan, m);
      } else {
        sweep_near(run.plan, run.pixels.published, m);
      }
    }
    move_lost(kLast);
    finish(first, m);
  }
}

template <int kBins, typename T>
void dual_run(const DualPlan& plan, const PixelRun& pixels) {
  const auto estimate_of = std::is_same_v<T, float> ? dual_estimate : fixed_estimate;
  const Estimate estimate = estimate_of(plan, pixels.published);
  const DualRun run(plan, pixels, estimate);
  for_each_dual<kBins, T>(run, [&](std::size_t first, Dual<kBins, T>& m) HWY_ATTR { finish_dual(run, first, m); });
}

// Calls use() with the number of bins as a type.
template <typename Use>
HWY_INLINE void with_bins(int bins, const Use& use) {
  switch (bins) {
    case 2:
      return use(std::integral_constant<int, 2>());
    case 4:
      return use(std::integral_constant<int, 4>());
    case 8:
      return use(std::integral_constant<int, 8>());
    case 16:
      return use(std::integral_constant<int, 16>());
    case 32:
      return use(std::integral_constant<int, 32>());
    default:
      return use(std::integral_constant<int, 64>());
  }
}

void solve_dual(const DualPlan& plan, const PixelRun& run) noexcept {
  with_bins(plan.bins, [&](auto bins) {
    const bool fixed = plan.fixed.unit > 0.0F;
    fixed ? dual_run<decltype(bins)::value, Short>(plan, run) : dual_run<decltype(bins)::value, float>(plan, run);
  });
}

}  // namespace bolo::deblur::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();
#endif

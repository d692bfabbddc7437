// ADMM's last iteration from the sweeps' dual (admm_plan.hpp). Included once for every instruction set.
//
//   paper / Boyd       here
//   y_i                samples
//   A                  x: input of each bin
//   D                  H x: Haar coefficients, c - Q t of the dual
//   u                  scaled dual of D = z: t / rho
//   w                  D + u, from which z = soft(w) and u = clip(w) follow
//  z - u              w - 2 clip(w): input of the x-update
#if defined(BOLO_DEBLUR_ADMM_INL) == defined(HWY_TARGET_TOGGLE)
#ifdef BOLO_DEBLUR_ADMM_INL
#undef BOLO_DEBLUR_ADMM_INL
#else
#define BOLO_DEBLUR_ADMM_INL
#endif

#include "src/deblur/dual-inl.hpp"

HWY_BEFORE_NAMESPACE();
namespace bolo::deblur::HWY_NAMESPACE {

// An iteration, with the constants of all its pixels, a vector a coefficient.
template <int kBins>
struct Iteration {
  static constexpr std::size_t kLevels = log2_of(kBins);
  HWY_ALIGN float keep[std::size_t{kBins}][kLanes];    // of t_i in w_i
  HWY_ALIGN float weight[std::size_t{kBins}][kLanes];  // of (z - u)_i in the estimate
  HWY_ALIGN float low[kLevels][Dual<kBins>::kPixels];
  HWY_ALIGN float high[kLevels][Dual<kBins>::kPixels];

  Iteration(const AdmmPlan& plan, const Estimate& estimate) {
    for (std::size_t i = 0; i < std::size_t{kBins}; ++i) {
      put(all(plan.keep[i]), keep[i]);
      put(all(estimate.coefficient[i]), weight[i]);
    }
  }

  void set_bounds(const AdmmPlan& plan, std::size_t v, Vec lambda) {
    for (std::size_t level = 0; level < kLevels; ++level) {
      const Vec bound = hn::Mul(all(plan.threshold[level]), lambda);
      put(bound, high[level] + v);
      put(hn::Neg(bound), low[level] + v);
    }
  }

  // Adds coefficient i's part to the estimate; `pull` is the jumps' effect on it.
  template <int kLevel>
  HWY_INLINE Vec add(const Dual<kBins>& m, int i, std::size_t v, Vec pull, Vec estimate) const {
    const Vec w = hn::Add(hn::MulAdd(at(keep[i]), at(m.state[i] + v), at(m.c[i] + v)), pull);
    const Vec u = clip(w, low[kLevel] + v, high[kLevel] + v);
    return hn::MulAdd(at(weight[i]), hn::NegMulAdd(all(2.0F), u, w), estimate);
  }
};

// The wavelets of support kSpan between the jumps `left` and `right`, and all finer ones below them.
template <int kBins, int kSpan>
HWY_INLINE Vec add_tree(const Iteration<kBins>& k, const Dual<kBins>& m, int begin, std::size_t v, Vec left, Vec right,
                        Vec estimate) {
  const Vec ends = hn::Add(left, right);
  const int middle = begin + kSpan / 2;
  constexpr int kLevel = log2_of(kSpan) - 1;
  if constexpr (kSpan == 2) {
    return k.template add<kLevel>(m, middle, v, ends, estimate);
  } else {
    const Vec inner = at(m.state[kBins + middle / 2] + v);
    estimate = k.template add<kLevel>(m, middle, v, hn::NegMulAdd(all(2.0F), inner, ends), estimate);
    estimate = add_tree<kBins, kSpan / 2>(k, m, begin, v, left, inner, estimate);
    return add_tree<kBins, kSpan / 2>(k, m, middle, v, inner, right, estimate);
  }
}

template <int kBins>
void admm_run(const AdmmPlan& plan, const PixelRun& pixels) {
  const Estimate estimate = admm_estimate(plan, pixels.published);
  const DualRun run(plan.start, pixels, estimate);
  Iteration<kBins> iteration(plan, estimate);
  if (pixels.lambda == nullptr) {
    for (std::size_t v = 0; v < Dual<kBins>::kPixels; v += kLanes)
      iteration.set_bounds(plan, v, all(plan.start.lambda));
  }
  for_each_dual<kBins>(run, [&](std::size_t first, Dual<kBins>& m) HWY_ATTR {
    for (std::size_t v = 0; v < m.end; v += kLanes) {
      const std::size_t count = std::min(kLanes, pixels.end - first - v);
      if (pixels.lambda != nullptr) {
        iteration.set_bounds(plan, v, load_lanes<float>(pixels.lambda, first + v, count));
      }
      const Vec left = at(m.jump(0) + v);
      const Vec right = at(m.jump(kBins) + v);
      Vec x = iteration.template add<log2_of(kBins) - 1>(m, 0, v, hn::Sub(left, right), at(m.estimate + v));
      x = add_tree<kBins, kBins>(iteration, m, 0, v, left, right, x);
      store_lanes(pixels, x, first + v, count);
    }
  });
}

void solve_admm(const AdmmPlan& plan, const PixelRun& run) noexcept {
  with_bins(plan.start.bins, [&](auto bins) { admm_run<decltype(bins)::value>(plan, run); });
}

}  // namespace bolo::deblur::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();
#endif

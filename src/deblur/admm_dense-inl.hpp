// ADMM with full matrices, for bins longer than a frame (admm_plan.hpp). Letters as in admm-inl.hpp;
// d = z - u. Included once for every instruction set.
#if defined(BOLO_DEBLUR_ADMM_DENSE_INL) == defined(HWY_TARGET_TOGGLE)
#ifdef BOLO_DEBLUR_ADMM_DENSE_INL
#undef BOLO_DEBLUR_ADMM_DENSE_INL
#else
#define BOLO_DEBLUR_ADMM_DENSE_INL
#endif

#include "src/deblur/block-inl.hpp"

HWY_BEFORE_NAMESPACE();
namespace bolo::deblur::HWY_NAMESPACE {

struct Dense {
  HWY_ALIGN Row b[kMaxDenseBins];  // (S^T M S + rho I)^-1 S^T M Y
  HWY_ALIGN Row w[kMaxDenseBins];  // the over-relaxed point, from which z and u follow
  HWY_ALIGN Row d[kMaxDenseBins];  // z - u
};

HWY_INLINE void add_sample(int bins, const std::array<float, kMaxDenseBins>& weights, Pair value, Row* to) {
  for (int i = 0; i < bins; ++i) {
    store(fma(all(weights[static_cast<std::size_t>(i)]), value, load(to[i])), to[i]);
  }
}

// b and the least-squares start of w, both zero so far; returns the samples' mean.
HWY_INLINE Pair begin_dense(const DensePlan& plan, const PixelRun& run, std::size_t at, std::size_t count, Dense& m) {
  Pair sum = pair(0.0F);
  for (int i = 0; i < plan.samples; ++i) {
    sum = sum + load_pixels(run, plan.slot[static_cast<std::size_t>(i)], at, count);
  }
  const Pair mean = all(plan.inverse_count) * sum;
  for (int i = 0; i < plan.samples; ++i) {
    const auto sample = static_cast<std::size_t>(i);
    const Pair value = load_pixels(run, plan.slot[sample], at, count) - mean;
    add_sample(plan.bins, plan.data[sample], value, m.b);
    add_sample(plan.bins, plan.start[sample], value, m.w);
  }
  return mean;
}

// D_i = b_i + sum_k rho (S^T M S + rho I)^-1_ik d_k
HWY_INLINE Pair update_coefficient(const DensePlan& plan, const Dense& m, int i) {
  Pair sum = load(m.b[i]);
  for (int k = 0; k < plan.bins; ++k) {
    sum = fma(all(plan.feedback[static_cast<std::size_t>(k)][static_cast<std::size_t>(i)]), load(m.d[k]), sum);
  }
  return sum;
}

HWY_INLINE void update_z(const DensePlan& plan, Pair limit, Dense& m) {
  for (int i = 0; i < plan.bins; ++i) {
    const Pair w = load(m.w[i]);
    const Pair u = clip(w, limit);
    store(w - u - u, m.d[i]);
  }
}

// w = alpha D + (1 - alpha) z + u = w + alpha (D - z)
HWY_INLINE void update_dual(const DensePlan& plan, Pair limit, Dense& m) {
  for (int i = 0; i < plan.bins; ++i) {
    const Pair w = load(m.w[i]);
    const Pair z = w - clip(w, limit);
    store(fma(all(plan.alpha), update_coefficient(plan, m, i) - z, w), m.w[i]);
  }
}

void solve_dense(const DensePlan& plan, const PixelRun& run) noexcept {
  for_each_block(run, [&](std::size_t at, std::size_t count) HWY_ATTR {
    Dense m;
    for (int i = 0; i < plan.bins; ++i) {
      store(pair(0.0F), m.b[i]);
      store(pair(0.0F), m.w[i]);
    }
    const Pair limit = all(plan.threshold) * load_lambda(run, plan.lambda, at, count);
    Pair estimate = begin_dense(plan, run, at, count, m);
    for (int k = 1; k < plan.iterations; ++k) {
      update_z(plan, limit, m);
      update_dual(plan, limit, m);
    }
    update_z(plan, limit, m);
    const auto& before = plan.basis[static_cast<std::size_t>(run.published.before)];
    const auto& after = plan.basis[static_cast<std::size_t>(run.published.after)];
    for (std::size_t i = 0; i < static_cast<std::size_t>(plan.bins); ++i) {
      const float weight = run.published.weight_before * before[i] + run.published.weight_after * after[i];
      estimate = fma(all(weight), update_coefficient(plan, m, static_cast<int>(i)), estimate);
    }
    store_pixels(run, estimate, at, count);
  });
}

}  // namespace bolo::deblur::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();
#endif

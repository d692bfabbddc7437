// ADMM on the structured problem (banded_plan.hpp). Included once for every instruction set.
//
//   paper / Boyd       here
//   y_i                samples, less their mean
//   V H^T, Y           G x = Y with G^-1 bidiagonal; Y enters as b = (p / rho) M Y
//   A                  x: input of each bin
//   D                  c = H x: Haar coefficients
//   z                  soft(w): copy of D that carries the l1 norm, w - clip(w)
//   u                  clip(w): scaled dual of D = z
//   w                  alpha c + (1 - alpha) z + u: the over-relaxed point from which z and u follow
//   carry              (1 - alpha) z + u, kept from one iteration to the next
//   v                  H^T (z - u)
//   rho, alpha         penalty, over-relaxation (tuning.hpp)
#if defined(BOLO_DEBLUR_ADMM_BANDED_INL) == defined(HWY_TARGET_TOGGLE)
#ifdef BOLO_DEBLUR_ADMM_BANDED_INL
#undef BOLO_DEBLUR_ADMM_BANDED_INL
#else
#define BOLO_DEBLUR_ADMM_BANDED_INL
#endif

#include "src/deblur/block-inl.hpp"

HWY_BEFORE_NAMESPACE();
namespace bolo::deblur::HWY_NAMESPACE {

// Memory of one block. `x` holds in turn v, s, x, and c.
template <std::size_t kCapacity>
struct Banded {
  HWY_ALIGN Row x[kCapacity];
  HWY_ALIGN Row b[kCapacity];
  HWY_ALIGN Row carry[kCapacity];
  HWY_ALIGN Row y[kMaxSlots];
};

// Samples less their mean; returns the mean. There is always a first one: the target's, at the latest.
HWY_INLINE Pair load_samples(const BandedPlan& plan, const PixelRun& run, std::size_t at, std::size_t count, Row* y) {
  Pair sum = load_pixels(run, plan.sample[0].slot, at, count);
  store(sum, y[0]);
  for (int i = 1; i < plan.samples; ++i) {
    const Pair value = load_pixels(run, plan.sample[static_cast<std::size_t>(i)].slot, at, count);
    sum = sum + value;
    store(value, y[i]);
  }
  const Pair mean = all(plan.inverse_count) * sum;
  store(load(y[0]) - mean, y[0]);
  for (int i = 1; i < plan.samples; ++i) store(load(y[i]) - mean, y[i]);
  return mean;
}

// b, and the inverse filter's x to begin with: constant over bins without a sample of their own.
HWY_INLINE void begin(const BandedPlan& plan, int bins, const Row* y, Row* b, Row* x) {
  const Pair reference = load(y[0]);
  Pair input = pair(0.0F);
  int bin = 0;
  for (int i = 0; i < bins; ++i) store(pair(0.0F), b[i]);
  for (int i = 1; i < plan.samples; ++i) {
    const SampleCoefficients& sample = plan.sample[static_cast<std::size_t>(i)];
    const Pair value = load(y[i]);
    const Pair before = load(y[i - 1]);
    store(all(sample.weight) * fnma(all(sample.decay), reference, value), b[sample.row]);
    input = fma(all(sample.inverse_gain), value - before, before);
    for (; bin <= sample.row; ++bin) store(input, x[bin]);
  }
  for (; bin < bins; ++bin) store(input, x[bin]);
}

// c = H x in place, unnormalised.
HWY_INLINE void haar_forward(int bins, Row* x) {
  for (int half = 1; half < bins; half *= 2) {
    for (int i = 0; i < bins; i += 2 * half) {
      const Pair left = load(x[i]);
      const Pair right = load(x[i + half]);
      store(left + right, x[i]);
      store(left - right, x[i + half]);
    }
  }
}

// x = H^T c in place, for coefficients that were divided by their support.
HWY_INLINE void haar_inverse(int bins, Row* x) {
  for (int half = bins / 2; half > 0; half /= 2) {
    for (int i = 0; i < bins; i += 2 * half) {
      const Pair sum = load(x[i]);
      const Pair difference = load(x[i + half]);
      store(sum + difference, x[i]);
      store(sum - difference, x[i + half]);
    }
  }
}

// z = soft(w), u = clip(w): leaves z - u in x and the next iteration's (1 - alpha) z + u in carry.
HWY_INLINE void split(const BandedPlan& plan, int i, Pair w, Row* carry, Row* x) {
  const RowCoefficients& row = plan.row[static_cast<std::size_t>(i)];
  const Pair u = clip(w, all(row.threshold));
  store(fma(all(plan.rest), w, all(plan.alpha) * u), carry[i]);
  store(fnma(all(2.0F), u, w), x[i]);
}

// w = c / support for the start: z and u of the inverse filter.
HWY_INLINE void begin_dual(const BandedPlan& plan, int bins, Row* carry, Row* x) {
  const float inverse_alpha = 1.0F / plan.alpha;
  for (int i = 0; i < bins; ++i) {
    const float scale = plan.row[static_cast<std::size_t>(i)].step * inverse_alpha;
    split(plan, i, all(scale) * load(x[i]), carry, x);
  }
}

// w = alpha c + (1 - alpha) z + u, then z and u of it.
HWY_INLINE void update_z_and_dual(const BandedPlan& plan, int bins, Row* carry, Row* x) {
  for (int i = 0; i < bins; ++i) {
    const Pair w = fma(all(plan.row[static_cast<std::size_t>(i)].step), load(x[i]), load(carry[i]));
    split(plan, i, w, carry, x);
  }
}

// (p^2/rho M + B^T B) s = b + B^T v by L D L^T, then x = B s; v and x in the same memory.
HWY_INLINE void update_x(const BandedPlan& plan, int bins, const Row* b, Row* x) {
  Pair v = load(x[0]);
  Pair q = pair(0.0F);
  for (int j = 0; j < bins; ++j) {
    const RowCoefficients& row = plan.row[static_cast<std::size_t>(j)];
    const Pair next = j + 1 < bins ? load(x[j + 1]) : v;
    q = fnma(all(row.lower), q, fnma(all(row.next_decay), next, v + load(b[j])));
    store(q, x[j]);
    v = next;
  }
  Pair s = all(plan.row[static_cast<std::size_t>(bins - 1)].pivot) * q;
  for (int j = bins - 2; j >= 0; --j) {
    const RowCoefficients& row = plan.row[static_cast<std::size_t>(j)];
    const Vec lower = all(plan.row[static_cast<std::size_t>(j) + 1].lower);
    const Pair below = fnma(lower, s, all(row.pivot) * load(x[j]));
    store(fnma(all(row.next_decay), below, s), x[j + 1]);
    s = below;
  }
  store(s, x[0]);
}

// kBins: the number of unknowns when it is known to the compiler, 0 when it is not.
template <int kBins>
HWY_INLINE void solve_block(const BandedPlan& plan, const PixelRun& run, std::size_t at, std::size_t count) {
  const int bins = kBins > 0 ? kBins : plan.bins;
  Banded<static_cast<std::size_t>(kBins > 0 ? kBins : kMaxBins)> m;
  const Pair mean = load_samples(plan, run, at, count, m.y);
  begin(plan, bins, m.y, m.b, m.x);
  haar_forward(bins, m.x);
  begin_dual(plan, bins, m.carry, m.x);
  haar_inverse(bins, m.x);
  update_x(plan, bins, m.b, m.x);
  for (int k = 1; k < plan.iterations; ++k) {
    haar_forward(bins, m.x);
    update_z_and_dual(plan, bins, m.carry, m.x);
    haar_inverse(bins, m.x);
    update_x(plan, bins, m.b, m.x);
  }
  const Pair estimate = all(0.5F) * (load(m.x[plan.before]) + load(m.x[plan.after]));
  store_pixels(run, estimate + mean, at, count);
}

template <int kBins>
void solve_run(const BandedPlan& plan, const PixelRun& run) noexcept {
  for_each_block(run, [&](std::size_t at, std::size_t count) HWY_ATTR { solve_block<kBins>(plan, run, at, count); });
}

void solve_banded(const BandedPlan& plan, const PixelRun& run) noexcept {
  switch (plan.bins) {
    case 8:
      return solve_run<8>(plan, run);
    case 16:
      return solve_run<16>(plan, run);
    case 32:
      return solve_run<32>(plan, run);
    case 64:
      return solve_run<64>(plan, run);
    default:
      return solve_run<0>(plan, run);
  }
}

}  // namespace bolo::deblur::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();
#endif

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
#include "src/deblur/dual-inl.hpp"

HWY_BEFORE_NAMESPACE();
namespace bolo::deblur::HWY_NAMESPACE {

// Bins whose Haar transform stays in registers: eight pairs where there are 32 registers, four where there are 16.
inline constexpr int kGroup = kLanes >= 16 ? 8 : 4;

// Memory of one block. `x` holds in turn v, s, x, and c.
template <int kBins>
struct Banded {
  HWY_ALIGN Row x[rows_of(kBins)];
  HWY_ALIGN Row b[rows_of(kBins)];
  HWY_ALIGN Row carry[rows_of(kBins)];
};

HWY_INLINE void butterfly_rows(float* left, float* right) {
  Pair a = load(left);
  Pair b = load(right);
  butterfly(a, b);
  store(a, left);
  store(b, right);
}

// The dual's x and, as carry, its t: the first w is c + u of the dual. And b. Returns the samples' mean.
template <int kBins>
HWY_INLINE Pair begin_from_dual(const BandedPlan& plan, const PixelRun& run, std::size_t at, std::size_t count,
                                const Dual<kBins>& dual, Banded<kBins>& m) {
  const Pair lambda = load(dual.lambda);
  const Pair scaled_lambda = all(plan.scaled) * lambda;
  const Pair mean = all(plan.inverse_count) * load(dual.sum);
  const Vec inverse_alpha = all(1.0F / plan.alpha);
  const Vec gain = all(plan.start.inverse_gain);
  for (int i = 0; i < kBins; ++i) {
    const Pair t = load(dual.t[i]);
    store(scaled_lambda * t, m.carry[i]);
    store(t, m.x[i]);
  }
  for (int half = kBins / 2; half > 0; half /= 2) {
    for (int i = 0; i < kBins; i += 2 * half) butterfly_rows(m.x[i], m.x[i + half]);
  }
  Pair unused = pair(0.0F);
  const Pair reference = load_pixels(run, plan.reference, at, count) - mean;
  Pair before = load_slot(plan.start, run, 0, at, count, unused) - mean;
  Pair begin = load(dual.jump[0]);
  for (int i = 0; i < kBins; ++i) {
    const RowCoefficients& row = plan.row[static_cast<std::size_t>(i)];
    const Pair y = load_slot(plan.start, run, i + 1, at, count, unused) - mean;
    const Pair end = load(dual.jump[i + 1]);
    const Pair bent = fma(all(plan.start.curvature), end - begin, load(m.x[i])) - shift_of(plan.start.gap, dual, i);
    store(inverse_alpha * (fma(gain, y - before, y) - lambda * bent), m.x[i]);
    store(all(row.weight) * fnma(all(row.decay), reference, y), m.b[i]);
    before = y;
    begin = end;
  }
  return mean;
}

// w = alpha c + (1 - alpha) z + u; z = soft(w), u = clip(w). Returns z - u; (1 - alpha) z + u = w - alpha z goes to
// carry.
HWY_INLINE Pair update_coefficient(const BandedPlan& plan, Pair lambda, int i, Pair c, float* carry) {
  const RowCoefficients& row = plan.row[static_cast<std::size_t>(i)];
  const Pair w = fma(all(row.step), c, load(carry));
  const Pair u = clip(w, all(row.threshold) * lambda);
  const Pair z = w - u;
  store(fnma(all(plan.alpha), z, w), carry);
  return z - u;
}

// The levels of the transform up to support kGroup, in registers, and z and u of all coefficients but the sum, which is
// left in x[0] for the coarser levels.
HWY_INLINE void update_fine(const BandedPlan& plan, Pair lambda, int first, Row* carry, Row* x) {
  Pair c[kGroup];
  HWY_UNROLL(8) for (int i = 0; i < kGroup; ++i) c[i] = load(x[i]);
  HWY_UNROLL(8) for (int half = 1; half < kGroup; half *= 2) {
    HWY_UNROLL(8) for (int i = 0; i < kGroup; i += 2 * half) butterfly(c[i], c[i + half]);
  }
  store(c[0], x[0]);
  HWY_UNROLL(8)
  for (int i = 1; i < kGroup; ++i) store(update_coefficient(plan, lambda, first + i, c[i], carry[i]), x[i]);
}

HWY_INLINE void inverse_fine(Row* x) {
  Pair c[kGroup];
  HWY_UNROLL(8) for (int i = 0; i < kGroup; ++i) c[i] = load(x[i]);
  HWY_UNROLL(8) for (int half = kGroup / 2; half > 0; half /= 2) {
    HWY_UNROLL(8) for (int i = 0; i < kGroup; i += 2 * half) butterfly(c[i], c[i + half]);
  }
  HWY_UNROLL(8) for (int i = 0; i < kGroup; ++i) store(c[i], x[i]);
}

// c = H x, z and u of it, v = H^T (z - u): x becomes v. `group` bins at a time for the fine levels, then the rest.
HWY_INLINE void update_z_and_dual(const BandedPlan& plan, Pair lambda, int bins, Row* carry, Row* x) {
  const int group = bins >= kGroup ? kGroup : 1;
  if (group > 1) {
    for (int i = 0; i < bins; i += group) update_fine(plan, lambda, i, carry + i, x + i);
  }
  for (int half = group; half < bins; half *= 2) {
    for (int i = 0; i < bins; i += 2 * half) butterfly_rows(x[i], x[i + half]);
  }
  for (int i = 0; i < bins; i += group) store(update_coefficient(plan, lambda, i, load(x[i]), carry[i]), x[i]);
  for (int half = bins / 2; half >= group; half /= 2) {
    for (int i = 0; i < bins; i += 2 * half) butterfly_rows(x[i], x[i + half]);
  }
  if (group == 1) return;
  for (int i = 0; i < bins; i += group) inverse_fine(x + i);
}

// Right side of row j of (p^2/rho M + B^T B) s = b + B^T v.
HWY_INLINE Pair right_side(const RowCoefficients& row, Pair v, Pair next_v, const float* b) {
  return fnma(all(row.next), next_v, fma(all(row.own), v, load(b)));
}

// Eliminates from both ends to the middle row and solves that; the right sides q stay in x.
HWY_INLINE Pair eliminate(const BandedPlan& plan, int bins, const Row* b, Row* x) {
  const RowCoefficients* row = plan.row.data();
  const int middle = bins / 2;
  Pair v = load(x[0]);
  Pair below_v = pair(0.0F);  // of the row below the lower chain, before q replaced it
  Pair upper = pair(0.0F);
  Pair lower = pair(0.0F);
  Vec outer_upper = all(0.0F);
  Vec outer_lower = all(0.0F);
  for (int j = 0; j < middle; ++j) {
    const Pair next_v = load(x[j + 1]);
    upper = fnma(outer_upper, upper, right_side(row[j], v, next_v, b[j]));
    outer_upper = all(row[j].eliminate);
    store(upper, x[j]);
    v = next_v;
    if (j == 0) continue;
    const int i = bins - j;
    const Pair lower_v = load(x[i]);
    lower = fnma(outer_lower, lower, right_side(row[i], lower_v, below_v, b[i]));
    outer_lower = all(row[i].eliminate);
    store(lower, x[i]);
    below_v = lower_v;
  }
  const Pair q = fnma(outer_upper, upper, right_side(row[middle], v, below_v, b[middle]));
  return fnma(outer_lower, lower, q);
}

// Substitutes from the middle to both ends and applies B: x_j = s_j - a s_{j-1}.
HWY_INLINE void substitute(const BandedPlan& plan, int bins, Pair s, Row* x) {
  const RowCoefficients* row = plan.row.data();
  const int middle = bins / 2;
  Pair upper = s;
  Pair lower = s;
  for (int j = 1; j <= middle; ++j) {
    const int i = middle - j;
    const Pair above = fnma(all(row[i].substitute), upper, load(x[i]));
    store(fnma(all(row[i].next_decay), above, upper), x[i + 1]);
    upper = above;
    if (j == middle) break;
    const int k = middle + j;
    const Pair below = fnma(all(row[k].substitute), lower, load(x[k]));
    store(fnma(all(row[k - 1].next_decay), lower, below), x[k]);
    lower = below;
  }
  store(upper, x[0]);
}

// v and x in the same memory.
HWY_INLINE void update_x(const BandedPlan& plan, int bins, const Row* b, Row* x) {
  substitute(plan, bins, eliminate(plan, bins, b, x), x);
}

template <typename Memory>
HWY_INLINE void iterate(const BandedPlan& plan, int bins, Pair lambda, Memory& m) {
  for (int k = 0; k < plan.iterations; ++k) {
    update_z_and_dual(plan, lambda, bins, m.carry, m.x);
    update_x(plan, bins, m.b, m.x);
  }
}

template <typename Memory>
HWY_INLINE void publish(const PixelRun& run, const Memory& m, Pair mean, std::size_t at, std::size_t count) {
  const Pair late = fma(all(run.published.weight_after), load(m.x[run.published.after]), mean);
  store_pixels(run, fma(all(run.published.weight_before), load(m.x[run.published.before]), late), at, count);
}

template <int kBins>
void solve_run(const BandedPlan& plan, const PixelRun& run) noexcept {
  Duals<kBins> blocks;
  std::size_t at = run.begin;
  while (at < run.end) {
    solve_duals(plan.start, run, at, blocks);
    for (const Dual<kBins>& dual : blocks) {
      const std::size_t count = std::min(kBlock, run.end - at);
      if (count == 0) break;
      Banded<kBins> m;
      const Pair mean = begin_from_dual(plan, run, at, count, dual, m);
      iterate(plan, kBins, load_lambda(run, plan.lambda, at, count), m);
      publish(run, m, mean, at, count);
      at += count;
    }
  }
}

void solve_banded(const BandedPlan& plan, const PixelRun& run) noexcept {
  switch (plan.bins) {
    case 2:
      return solve_run<2>(plan, run);
    case 4:
      return solve_run<4>(plan, run);
    case 8:
      return solve_run<8>(plan, run);
    case 16:
      return solve_run<16>(plan, run);
    case 32:
      return solve_run<32>(plan, run);
    default:
      return solve_run<64>(plan, run);
  }
}

}  // namespace bolo::deblur::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();
#endif

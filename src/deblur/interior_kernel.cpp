// A primal-dual interior point on the dual of interior_plan.hpp.
//
//   v          the dual's variable, in units of lambda_s; h, x, f and all multipliers in units of `size`
//   q          lambda_s / size: what v weighs beside h
//   Bound      |t| <= b, t = psi^T v for a wavelet psi = (1 .. 1, -1 .. -1) or the sum, t = v_i for a leaf:
//              above = b - t, below = b + t, and their multipliers; c = z_above - z_below
//   tau        what each slack times its multiplier should be after the step
//   D, k       the bound's part of the Newton system: D = z_above / above + z_below / below, force k = tau / above -
//              tau / below
//   alpha, beta  of a subtree: the sum of its steps is alpha + beta y for a common force y on all its leaves
#include "src/deblur/interior_kernel.hpp"

#include "src/core/simd_targets.hpp"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "src/deblur/interior_kernel.cpp"
#include <hwy/foreach_target.h>
#include <hwy/highway.h>

#include <algorithm>
#include <cmath>

#include "src/deblur/block-inl.hpp"
#include "src/deblur/isa.hpp"
#include "src/motion/targets.hpp"

HWY_BEFORE_NAMESPACE();
namespace bolo::deblur::HWY_NAMESPACE {

constexpr float kCentring = 0.1F;  // of the mean product, the next tau
constexpr float kBack = 0.99F;     // of the way to the nearest bound
constexpr float kLeastTau = 1e-7F;
constexpr float kBegin = 0.3F;  // all multipliers, to begin with
constexpr float kLeastSize = 1e-6F;
constexpr float kTiny = 1e-30F;

struct Bound {
  HWY_ALIGN Row above;
  HWY_ALIGN Row below;
  HWY_ALIGN Row z_above;
  HWY_ALIGN Row z_below;
  HWY_ALIGN Row per_above;  // 1 / above
  HWY_ALIGN Row per_below;
  HWY_ALIGN Row step;    // of t
  HWY_ALIGN Row border;  // of t, for a unit of the border's multiplier
};

struct Tree {
  HWY_ALIGN Row alpha;
  HWY_ALIGN Row beta;
  HWY_ALIGN Row border;  // alpha of a unit of the border's multiplier
};

struct Wavelet {
  Bound bound;
  Tree tree;
  HWY_ALIGN Row d;
  HWY_ALIGN Row k;
  HWY_ALIGN Row share;  // 1 / (1 + D (beta_left + beta_right)); of the sum 1 / (1 + D beta)
  HWY_ALIGN Row force;  // y, then the wavelet's part of x
};

struct Leaf {
  Bound bound;
  Tree tree;
  HWY_ALIGN Row h;
  HWY_ALIGN Row v;
  HWY_ALIGN Row lost;  // e
  HWY_ALIGN Row rhs;
  HWY_ALIGN Row force;
};

struct Interior {
  Wavelet wavelet[kMaxDualBins];  // [0]: the sum; [i]: the wavelet with its middle at bin i (dual_plan.hpp)
  Leaf leaf[kMaxDualBins];
  HWY_ALIGN Row sum;   // of all samples
  HWY_ALIGN Row size;  // of the values less their mean
  HWY_ALIGN Row q;
  Pair tau;
};

HWY_INLINE Vec max(Vec x, Vec y) { return hn::Max(x, y); }
HWY_INLINE Pair max(Pair x, Pair y) { return {max(x.a, y.a), max(x.b, y.b)}; }
HWY_INLINE Pair min(Pair x, Pair y) { return {hn::Min(x.a, y.a), hn::Min(x.b, y.b)}; }
HWY_INLINE Pair fma(Pair k, Pair x, Pair y) { return {hn::MulAdd(k.a, x.a, y.a), hn::MulAdd(k.b, x.b, y.b)}; }
HWY_INLINE Pair fnma(Pair k, Pair x, Pair y) { return {hn::NegMulAdd(k.a, x.a, y.a), hn::NegMulAdd(k.b, x.b, y.b)}; }
HWY_INLINE Pair rough_reciprocal(Pair x) { return {hn::ApproximateReciprocal(x.a), hn::ApproximateReciprocal(x.b)}; }
// Newton's step after the processor's 12 bits.
HWY_INLINE Pair reciprocal(Pair x) {
  const Pair r = rough_reciprocal(x);
  return r * fnma(x, r, pair(2.0F));
}

HWY_INLINE Pair load_slot(const InteriorPlan& plan, const PixelRun& run, int slot, std::size_t at, std::size_t count,
                          Pair& sum) {
  const SlotValue& value = plan.value[static_cast<std::size_t>(slot)];
  const Pair before = load_pixels(run, value.before, at, count);
  if (HWY_LIKELY(value.before == slot)) {
    sum = sum + before;
    return before;
  }
  if (value.after == value.before) return before;
  return fma(all(value.weight), load_pixels(run, value.after, at, count) - before, before);
}

HWY_INLINE void begin_bound(float limit, Bound& b) {
  store(pair(limit), b.above);
  store(pair(limit), b.below);
  store(pair(kBegin), b.z_above);
  store(pair(kBegin), b.z_below);
}

HWY_INLINE void begin(const InteriorPlan& plan, const PixelRun& run, std::size_t at, std::size_t count, Interior& m) {
  Pair sum = pair(0.0F);
  Pair before = load_slot(plan, run, 0, at, count, sum);
  for (int i = 0; i < plan.bins; ++i) {
    const Pair y = load_slot(plan, run, i + 1, at, count, sum);
    store(fma(all(plan.inverse_gain), y - before, y), m.leaf[i].h);
    before = y;
  }
  const Pair mean = all(plan.inverse_count) * sum;
  const Pair lambda = all(plan.lambda_scale) * load_lambda(run, plan.lambda, at, count);
  Pair size = pair(kLeastSize) + lambda;
  Pair largest = pair(0.0F);
  for (int i = 0; i < plan.bins; ++i) {
    const Pair h = load(m.leaf[i].h) - mean;
    largest = max(largest, max(h, pair(0.0F) - h));
    store(h, m.leaf[i].h);
  }
  size = size + largest;
  const Pair per_size = pair(1.0F) / size;
  float products = 0.0F;  // of slack and multiplier, their mean
  for (int i = 0; i < plan.bins; ++i) {
    Leaf& leaf = m.leaf[i];
    store(per_size * load(leaf.h), leaf.h);
    store(pair(0.0F), leaf.v);
    store(pair(0.0F), leaf.lost);
    begin_bound(plan.bound, leaf.bound);
    const auto support = static_cast<float>(i == 0 ? plan.bins : 2 * (i & -i));
    begin_bound(std::sqrt(support), m.wavelet[i].bound);
    products += kBegin * (plan.bound + std::sqrt(support)) / static_cast<float>(2 * plan.bins);
  }
  m.tau = pair(kCentring * products);
  store(sum, m.sum);
  store(size, m.size);
  store(lambda * per_size, m.q);
}

struct Linear {
  Pair d;
  Pair k;
};

HWY_INLINE Linear linearise(Pair tau, Bound& b) {
  const Pair above = load(b.above);
  const Pair below = load(b.below);
  const Pair both = reciprocal(above * below);
  const Pair per_above = both * below;
  const Pair per_below = both * above;
  store(per_above, b.per_above);
  store(per_below, b.per_below);
  return {fma(load(b.z_above), per_above, load(b.z_below) * per_below), tau * (per_above - per_below)};
}

// The residual of every leaf: h + e_i - a e_{i-1} - q Q v - k.
HWY_INLINE void linearise_leaves(const InteriorPlan& plan, Interior& m) {
  const Pair q = all(plan.curvature) * load(m.q);
  const Vec a = all(plan.decay);
  Pair row_before = pair(0.0F);  // of W B^T v
  Pair lost_before = pair(0.0F);
  Pair v = load(m.leaf[0].v);
  for (int i = 0; i < plan.bins; ++i) {
    Leaf& leaf = m.leaf[i];
    const InteriorRow& row = plan.row[static_cast<std::size_t>(i)];
    const Pair next = i + 1 < plan.bins ? load(m.leaf[i + 1].v) : pair(0.0F);
    const Pair w = all(row.weight) * fnma(a, next, v);
    const Linear bound = linearise(m.tau, leaf.bound);
    Pair rhs = load(leaf.h) - bound.k - lost_before;
    rhs = fnma(q, fnma(a, row_before, w), rhs);
    store(rhs, leaf.rhs);
    const Pair diagonal = fma(all(row.diagonal), load(m.q), bound.d);
    if (HWY_LIKELY(row.weight != 0.0F || i == plan.border)) {
      const Pair beta = reciprocal(diagonal);
      store(beta, leaf.tree.beta);
      store(beta * rhs, leaf.tree.alpha);
      lost_before = pair(0.0F);
    } else {
      store(diagonal, leaf.bound.step);  // until the step is known
      store(pair(0.0F), leaf.tree.beta);
      store(fma(all(row.carry), next, pair(0.0F) - v), leaf.tree.alpha);
      lost_before = all(row.carry) * load(leaf.lost);
    }
    row_before = w;
    v = next;
  }
}

HWY_INLINE Tree& left_of(int i, Interior& m) {
  const int half = i & -i;
  return half == 1 ? m.leaf[i - 1].tree : m.wavelet[i - half / 2].tree;
}
HWY_INLINE Tree& right_of(int i, Interior& m) {
  const int half = i & -i;
  return half == 1 ? m.leaf[i].tree : m.wavelet[i + half / 2].tree;
}

HWY_INLINE void keep(const Linear& bound, Pair share, Wavelet& w) {
  store(bound.d, w.d);
  store(bound.k, w.k);
  store(share, w.share);
}

// From the leaves to the sum.
HWY_INLINE void eliminate(const InteriorPlan& plan, Interior& m) {
  for (int half = 1; half < plan.bins; half *= 2) {
    for (int i = half; i < plan.bins; i += 2 * half) {
      Wavelet& w = m.wavelet[i];
      const Linear bound = linearise(m.tau, w.bound);
      const Tree& left = left_of(i, m);
      const Tree& right = right_of(i, m);
      const Pair left_beta = load(left.beta);
      const Pair right_beta = load(right.beta);
      const Pair left_alpha = fnma(left_beta, bound.k, load(left.alpha));
      const Pair right_alpha = fma(right_beta, bound.k, load(right.alpha));
      const Pair beta = left_beta + right_beta;
      const Pair share = reciprocal(fma(bound.d, beta, pair(1.0F)));
      const Pair twice_d = bound.d + bound.d;
      const Pair crossed = fma(right_beta, left_alpha, left_beta * right_alpha);
      store(share * fma(twice_d, crossed, left_alpha + right_alpha), w.tree.alpha);
      store(share * fma(twice_d + twice_d, left_beta * right_beta, beta), w.tree.beta);
      keep(bound, share, w);
    }
  }
  Wavelet& sum = m.wavelet[0];
  const Linear bound = linearise(m.tau, sum.bound);
  keep(bound, reciprocal(fma(bound.d, load(m.wavelet[plan.bins / 2].tree.beta), pair(1.0F))), sum);
}

// The largest share of the way to a bound, of slacks and multipliers, that a whole step would go.
HWY_INLINE Pair reach(Pair tau, const Bound& b, Pair largest) {
  const Pair step = load(b.step);
  const Pair per_above = load(b.per_above);
  const Pair per_below = load(b.per_below);
  const Pair z_above = load(b.z_above);
  const Pair z_below = load(b.z_below);
  const Pair to_above = step * per_above;
  const Pair to_below = step * per_below;
  largest = max(largest, max(to_above, pair(0.0F) - to_below));
  const Pair per_both = rough_reciprocal(max(z_above * z_below, pair(kTiny)));
  const Pair down_above = fnma(tau * per_above, per_both * z_below, pair(1.0F) - to_above);
  const Pair down_below = fnma(tau * per_below, per_both * z_above, pair(1.0F) + to_below);
  return max(largest, max(down_above, down_below));
}

// The steps, from the sum to the leaves. kBorder: those for a unit of the border's multiplier.
template <bool kBorder>
HWY_INLINE void substitute(const InteriorPlan& plan, Interior& m) {
  const auto alpha_of = [](const Tree& tree) HWY_ATTR { return load(kBorder ? tree.border : tree.alpha); };
  const auto step_of = [](Bound& b) -> float* { return kBorder ? b.border : b.step; };
  Wavelet& sum = m.wavelet[0];
  const Pair sum_k = kBorder ? pair(0.0F) : load(sum.k);
  const Tree& whole = m.wavelet[plan.bins / 2].tree;
  const Pair total = fnma(load(whole.beta), sum_k, alpha_of(whole)) * load(sum.share);
  store(total, step_of(sum.bound));
  store(pair(0.0F) - fma(load(sum.d), total, sum_k), m.wavelet[plan.bins / 2].force);
  for (int half = plan.bins / 2; half > 0; half /= 2) {
    for (int i = half; i < plan.bins; i += 2 * half) {
      Wavelet& w = m.wavelet[i];
      const Tree& left = left_of(i, m);
      const Tree& right = right_of(i, m);
      const Pair left_beta = load(left.beta);
      const Pair right_beta = load(right.beta);
      const Pair y = load(w.force);
      Pair step = fma(left_beta - right_beta, y, alpha_of(left) - alpha_of(right));
      if (!kBorder) step = fnma(left_beta + right_beta, load(w.k), step);
      step = load(w.share) * step;
      const Pair force = kBorder ? load(w.d) * step : fma(load(w.d), step, load(w.k));
      store(step, step_of(w.bound));
      store(y - force, half == 1 ? m.leaf[i - 1].force : m.wavelet[i - half / 2].force);
      store(y + force, half == 1 ? m.leaf[i].force : m.wavelet[i + half / 2].force);
    }
  }
  for (int i = 0; i < plan.bins; ++i) {
    Leaf& leaf = m.leaf[i];
    const Pair y = load(leaf.force);
    const Pair step = fma(load(leaf.tree.beta), y, alpha_of(leaf.tree));
    if (!kBorder && plan.row[static_cast<std::size_t>(i)].weight == 0.0F && i != plan.border) {
      store(load(leaf.bound.step) * step - load(leaf.rhs) - y, leaf.lost);
    }
    store(step, step_of(leaf.bound));
  }
}

// One lost sample: its multiplier, so that v_j = a v_{j+1} after the whole step, and the steps with it.
HWY_INLINE void solve_border(const InteriorPlan& plan, Interior& m) {
  const Vec a = all(plan.decay);
  for (int i = 0; i < plan.bins; ++i) store(pair(0.0F), m.leaf[i].tree.border);
  Leaf& lost = m.leaf[plan.border];
  Leaf& next = m.leaf[plan.border + 1];
  store(load(lost.tree.beta), lost.tree.border);
  store(pair(0.0F) - a * load(next.tree.beta), next.tree.border);
  for (int half = 1; half < plan.bins; half *= 2) {
    for (int i = half; i < plan.bins; i += 2 * half) {
      Wavelet& w = m.wavelet[i];
      const Tree& left = left_of(i, m);
      const Tree& right = right_of(i, m);
      const Pair left_alpha = load(left.border);
      const Pair right_alpha = load(right.border);
      const Pair crossed = fma(load(right.beta), left_alpha, load(left.beta) * right_alpha);
      const Pair d = load(w.d);
      store(load(w.share) * fma(d + d, crossed, left_alpha + right_alpha), w.tree.border);
    }
  }
  substitute<true>(plan, m);
  const Pair missing = fnma(a, load(next.v) + load(next.bound.step), load(lost.v) + load(lost.bound.step));
  const Pair effect = fnma(a, load(next.bound.border), load(lost.bound.border));
  const Pair multiplier = pair(0.0F) - missing / effect;
  for (int i = 0; i < plan.bins; ++i) {
    for (Bound* b : {&m.leaf[i].bound, &m.wavelet[i].bound}) {
      store(fma(multiplier, load(b->border), load(b->step)), b->step);
    }
  }
}

HWY_INLINE Pair move_bound(Pair tau, Pair part, Bound& b) {
  const Pair step = load(b.step);
  const Pair z_above = load(b.z_above);
  const Pair z_below = load(b.z_below);
  const Pair to_above = fma(z_above, step, tau) * load(b.per_above) - z_above;
  const Pair to_below = fnma(z_below, step, tau) * load(b.per_below) - z_below;
  const Pair above = max(fnma(part, step, load(b.above)), pair(kTiny));
  const Pair below = max(fma(part, step, load(b.below)), pair(kTiny));
  const Pair new_above = max(fma(part, to_above, z_above), pair(kTiny));
  const Pair new_below = max(fma(part, to_below, z_below), pair(kTiny));
  store(above, b.above);
  store(below, b.below);
  store(new_above, b.z_above);
  store(new_below, b.z_below);
  return fma(above, new_above, below * new_below);
}

// One step of Newton.
HWY_INLINE void step(const InteriorPlan& plan, Interior& m) {
  linearise_leaves(plan, m);
  eliminate(plan, m);
  substitute<false>(plan, m);
  if (plan.border >= 0) solve_border(plan, m);
  Pair largest = pair(kBack);
  for (int i = 0; i < plan.bins; ++i) {
    largest = reach(m.tau, m.leaf[i].bound, reach(m.tau, m.wavelet[i].bound, largest));
  }
  const Pair part = min(all(kBack) * reciprocal(largest), pair(1.0F));
  Pair products = pair(0.0F);
  for (int i = 0; i < plan.bins; ++i) {
    Leaf& leaf = m.leaf[i];
    store(fma(part, load(leaf.bound.step), load(leaf.v)), leaf.v);
    products = products + move_bound(m.tau, part, leaf.bound) + move_bound(m.tau, part, m.wavelet[i].bound);
  }
  m.tau = max(all(kCentring / static_cast<float>(4 * plan.bins)) * products, pair(kLeastTau));
}

HWY_INLINE Pair multiplier(const Bound& b) { return load(b.z_above) - load(b.z_below); }

// The input in one of the `parts` bins of an interval, of the values less their mean.
HWY_INLINE Pair input_at(const InteriorPlan& plan, const Interior& m, int bin) {
  const int frame = bin / plan.parts;
  const int from_end = plan.parts - 1 - bin % plan.parts;
  Pair x = multiplier(m.wavelet[0].bound);
  for (int half = plan.bins / 2; half > 0; half /= 2) {
    const Pair c = multiplier(m.wavelet[(frame & ~(2 * half - 1)) + half].bound);
    x = (frame & half) != 0 ? x - c : x + c;
  }
  if (from_end > 1) return load(m.size) * x;
  const Vec within = all(from_end == 0 ? plan.overshoot : -plan.overshoot);
  return load(m.size) * fma(within, multiplier(m.leaf[frame].bound), x);
}

void solve(const InteriorPlan& plan, const PixelRun& run) noexcept {
  Interior m;
  for_each_block(run, [&](std::size_t at, std::size_t count) HWY_ATTR {
    begin(plan, run, at, count, m);
    for (int k = 0; k < plan.steps; ++k) step(plan, m);
    const Pair sum = load(m.sum);
    const Pair mean = fma(all(plan.inverse_count), sum, sum - sum);  // a sample that is not a number shows
    const Pair late = fma(all(run.published.weight_after), input_at(plan, m, run.published.after), mean);
    store_pixels(run, fma(all(run.published.weight_before), input_at(plan, m, run.published.before), late), at, count);
  });
}

const InteriorKernel& interior_kernel() {
  static const InteriorKernel table{HWY_TARGET == HWY_SCALAR ? "scalar" : hwy::TargetName(HWY_TARGET), solve};
  return table;
}

}  // namespace bolo::deblur::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace bolo::deblur {

HWY_EXPORT(interior_kernel);

const InteriorKernel& best_interior_kernel() {
  static const auto found = motion::tables_of_targets(
      HWY_TARGETS, []() -> const InteriorKernel& { return HWY_DYNAMIC_DISPATCH(interior_kernel)(); });
  return motion::table_for(found, best_isa());
}

}  // namespace bolo::deblur
#endif

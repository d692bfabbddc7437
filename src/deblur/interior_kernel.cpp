// Interior point on the dual of interior_plan.hpp: Newton's method on bounds that are smoothed less from step to step.
//
//   v       the dual's variable, in units of lambda_s; h, x, f and all multipliers in units of `size`
//   q       lambda_s / size: weight of v relative to h
//   Bound   |t| <= b, with its multiplier c: t = psi^T v for a wavelet psi = (1 .. 1, -1 .. -1) or the sum, t = v_i for
//           a leaf
//   tau     smooths it: c (b^2 - t^2) / 2 = tau t; at tau = 0: c = 0, or t is at the bound
//   room, pull, push   its Newton equation: room c = push + pull (step of t), room = (b^2 - t^2) / 2, push = tau t,
//           pull = tau + t c, without t c where their signs differ, so that it stays positive
//   alpha, beta  of a subtree: the sum of its steps is alpha + beta y for a common force y on all its leaves
//
// A multiplier for each side of a bound, and slacks kept beside t, cost twice the work and more steps.
#include "src/deblur/interior_plan.hpp"

#include "src/core/simd_targets.hpp"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "src/deblur/interior_kernel.cpp"
#include <hwy/foreach_target.h>
#include <hwy/highway.h>

#include "src/deblur/block-inl.hpp"

HWY_BEFORE_NAMESPACE();
namespace bolo::deblur::HWY_NAMESPACE {

constexpr float kBegin = 0.3F;  // tau
constexpr float kFall = 0.95F;  // of tau, for a whole step
constexpr float kLeastTau = 1e-7F;
constexpr float kBack = 0.998F;   // share of the way to the nearest bound
constexpr float kEdge = 2.5e-7F;  // share of a bound that t keeps away from it
constexpr float kLeastSize = 1e-6F;

struct Bound {
  HWY_ALIGN Row t;
  HWY_ALIGN Row c;     // on the way down to the leaves: y
  HWY_ALIGN Row step;  // of t; on the way up to the sum: alpha of its subtree
  HWY_ALIGN Row beta;
};

struct Wavelet {
  Bound bound;
  HWY_ALIGN Row room;  // room, pull and push over room + pull (beta_left + beta_right); sum: over room + pull beta
  HWY_ALIGN Row pull;
  HWY_ALIGN Row push;
};

struct Leaf {
  Bound bound;
  HWY_ALIGN Row h;
  HWY_ALIGN Row lost;  // e
  HWY_ALIGN Row rest;  // h + e_i - a e_{i-1} - q Q v
};

// Response to one unit of the border's multiplier.
struct Border {
  HWY_ALIGN Row alpha[2][kMaxDualBins];  // leaves; wavelets
  HWY_ALIGN Row step[2][kMaxDualBins];
  HWY_ALIGN Row c[2][kMaxDualBins];
};

struct Interior {
  Wavelet wavelet[kMaxDualBins];  // [0]: the sum; [i]: the wavelet with its middle at bin i (dual_plan.hpp)
  Leaf leaf[kMaxDualBins];
  HWY_ALIGN Row sum;   // of all samples
  HWY_ALIGN Row size;  // of the values less their mean
  HWY_ALIGN Row q;
  Pair tau;
  Border border;
};

HWY_INLINE Vec max(Vec x, Vec y) { return hn::Max(x, y); }
HWY_INLINE Pair max(Pair x, Pair y) { return {max(x.a, y.a), max(x.b, y.b)}; }
HWY_INLINE Pair min(Pair x, Pair y) { return {hn::Min(x.a, y.a), hn::Min(x.b, y.b)}; }
HWY_INLINE Pair fma(Pair k, Pair x, Pair y) { return {hn::MulAdd(k.a, x.a, y.a), hn::MulAdd(k.b, x.b, y.b)}; }
HWY_INLINE Pair fnma(Pair k, Pair x, Pair y) { return {hn::NegMulAdd(k.a, x.a, y.a), hn::NegMulAdd(k.b, x.b, y.b)}; }
HWY_INLINE Pair newton(Pair x, Pair r) { return r * fnma(x, r, pair(2.0F)); }
// Good to 12 bits on every processor: with ARM's 8 bits some pixels end kelvins off.
HWY_INLINE Pair rough_reciprocal(Pair x) {
  const Pair r{hn::ApproximateReciprocal(x.a), hn::ApproximateReciprocal(x.b)};
  return HWY_ARCH_X86 ? r : newton(x, r);
}
HWY_INLINE Pair magnitude(Pair x) { return {hn::Abs(x.a), hn::Abs(x.b)}; }
HWY_INLINE Pair sign(Pair x) { return {hn::CopySign(all(1.0F), x.a), hn::CopySign(all(1.0F), x.b)}; }
HWY_INLINE Pair reciprocal(Pair x) { return newton(x, rough_reciprocal(x)); }

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

HWY_INLINE void begin_bound(Bound& b) {
  store(pair(0.0F), b.t);
  store(pair(0.0F), b.c);
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
  for (int i = 0; i < plan.bins; ++i) {
    Leaf& leaf = m.leaf[i];
    store(per_size * load(leaf.h), leaf.h);
    store(pair(0.0F), leaf.lost);
    begin_bound(leaf.bound);
    begin_bound(m.wavelet[i].bound);
  }
  m.tau = pair(kBegin);
  store(sum, m.sum);
  store(size, m.size);
  store(lambda * per_size, m.q);
}

struct Linear {
  Pair room;
  Pair pull;
  Pair push;
};

HWY_INLINE Linear linearise(Pair tau, float limit, const Bound& b) {
  const Pair t = load(b.t);
  const Pair below = fma(all(0.5F), t, pair(0.5F * limit));
  return {(pair(limit) - t) * below, max(fma(t, load(b.c), tau), tau), tau * t};
}

HWY_INLINE void eliminate_leaves(const InteriorPlan& plan, Interior& m) {
  const Pair q = load(m.q);
  const Pair curvature = all(plan.curvature) * q;
  const Vec a = all(plan.decay);
  Pair row_before = pair(0.0F);  // of W B^T v
  Pair lost_before = pair(0.0F);
  Pair v = load(m.leaf[0].bound.t);
  for (int i = 0; i < plan.bins; ++i) {
    Leaf& leaf = m.leaf[i];
    const InteriorRow& row = plan.row[static_cast<std::size_t>(i)];
    const Pair next = i + 1 < plan.bins ? load(m.leaf[i + 1].bound.t) : pair(0.0F);
    const Pair w = all(row.weight) * fnma(a, next, v);
    const Pair rest = fnma(curvature, fnma(a, row_before, w), load(leaf.h) - lost_before);
    store(rest, leaf.rest);
    lost_before = pair(0.0F);
    if (HWY_LIKELY(row.weight != 0.0F || i == plan.border)) {
      const Linear bound = linearise(m.tau, plan.bound, leaf.bound);
      const Pair share = reciprocal(fma(all(row.diagonal) * q, bound.room, bound.pull));
      store(share * bound.room, leaf.bound.beta);
      store(share * (bound.room * rest - bound.push), leaf.bound.step);
    } else {
      store(pair(0.0F), leaf.bound.beta);
      store(fma(all(row.carry), next, pair(0.0F) - v), leaf.bound.step);
      lost_before = all(row.carry) * load(leaf.lost);
    }
    row_before = w;
    v = next;
  }
}

HWY_INLINE Bound& left_of(int i, Interior& m) {
  const int half = i & -i;
  return half == 1 ? m.leaf[i - 1].bound : m.wavelet[i - half / 2].bound;
}
HWY_INLINE Bound& right_of(int i, Interior& m) {
  const int half = i & -i;
  return half == 1 ? m.leaf[i].bound : m.wavelet[i + half / 2].bound;
}

// Calls on(i, half) for all wavelets, from the leaves to the whole window; on_way_down() in reverse order.
template <typename On>
HWY_INLINE void on_way_up(int bins, const On& on) {
  for (int half = 1; half < bins; half *= 2) {
    for (int i = half; i < bins; i += 2 * half) on(i, half);
  }
}
template <typename On>
HWY_INLINE void on_way_down(int bins, const On& on) {
  for (int half = bins / 2; half > 0; half /= 2) {
    for (int i = half; i < bins; i += 2 * half) on(i, half);
  }
}

HWY_INLINE Linear keep(const Linear& bound, Pair beta, Wavelet& w) {
  const Pair share = reciprocal(fma(bound.pull, beta, bound.room));
  const Linear kept{share * bound.room, share * bound.pull, share * bound.push};
  store(kept.room, w.room);
  store(kept.pull, w.pull);
  store(kept.push, w.push);
  return kept;
}

HWY_INLINE void eliminate(const InteriorPlan& plan, Interior& m) {
  eliminate_leaves(plan, m);
  on_way_up(plan.bins, [&](int i, int /*half*/) HWY_ATTR {
    Wavelet& w = m.wavelet[i];
    const Bound& left = left_of(i, m);
    const Bound& right = right_of(i, m);
    const Pair left_beta = load(left.beta);
    const Pair right_beta = load(right.beta);
    const Pair left_alpha = load(left.step);
    const Pair right_alpha = load(right.step);
    const Pair beta = left_beta + right_beta;
    const Linear bound = keep(linearise(m.tau, plan.row[static_cast<std::size_t>(i)].limit, w.bound), beta, w);
    const Pair twice = bound.pull + bound.pull;
    const Pair crossed = fma(right_beta, left_alpha, left_beta * right_alpha);
    const Pair alpha = fma(twice, crossed, bound.room * (left_alpha + right_alpha));
    store(fma(bound.push, right_beta - left_beta, alpha), w.bound.step);
    store(fma(twice + twice, left_beta * right_beta, bound.room * beta), w.bound.beta);
  });
  Wavelet& sum = m.wavelet[0];
  keep(linearise(m.tau, plan.row[0].limit, sum.bound), load(m.wavelet[plan.bins / 2].bound.beta), sum);
}

HWY_INLINE void substitute_leaf(const InteriorPlan& plan, int i, Pair y, Interior& m) {
  Leaf& leaf = m.leaf[i];
  const InteriorRow& row = plan.row[static_cast<std::size_t>(i)];
  const Pair step = fma(load(leaf.bound.beta), y, load(leaf.bound.step));
  const Pair held = all(row.diagonal) * load(m.q) * step;
  const Pair force = load(leaf.rest) + y;
  store(step, leaf.bound.step);
  if (HWY_LIKELY(row.weight != 0.0F || i == plan.border)) return store(force - held, leaf.bound.c);
  const Linear bound = linearise(m.tau, plan.bound, leaf.bound);
  const Pair c = fma(bound.pull, step, bound.push) / bound.room;
  store(c, leaf.bound.c);
  store(held + c - force, leaf.lost);
}

// Computes the steps and the multipliers, from the sum down to the leaves.
HWY_INLINE void substitute(const InteriorPlan& plan, Interior& m) {
  Wavelet& sum = m.wavelet[0];
  const Bound& whole = m.wavelet[plan.bins / 2].bound;
  const Pair alpha = load(whole.step);
  const Pair sum_push = load(sum.push);
  const Pair sum_c = fma(load(sum.pull), alpha, sum_push);
  store(fnma(sum_push, load(whole.beta), load(sum.room) * alpha), sum.bound.step);
  store(sum_c, sum.bound.c);
  store(pair(0.0F) - sum_c, m.wavelet[plan.bins / 2].bound.c);
  on_way_down(plan.bins, [&](int i, int half) HWY_ATTR {
    Wavelet& w = m.wavelet[i];
    const Bound& left = left_of(i, m);
    const Bound& right = right_of(i, m);
    const Pair left_beta = load(left.beta);
    const Pair right_beta = load(right.beta);
    const Pair y = load(w.bound.c);
    const Pair difference = fma(left_beta - right_beta, y, load(left.step) - load(right.step));
    const Pair push = load(w.push);
    const Pair c = fma(load(w.pull), difference, push);
    store(fnma(push, left_beta + right_beta, load(w.room) * difference), w.bound.step);
    store(c, w.bound.c);
    if (half > 1) {
      store(y - c, m.wavelet[i - half / 2].bound.c);
      store(y + c, m.wavelet[i + half / 2].bound.c);
    } else {
      substitute_leaf(plan, i - 1, y - c, m);
      substitute_leaf(plan, i, y + c, m);
    }
  });
}

// One lost sample: its multiplier, such that v_j = a v_{j+1} after the whole step, and its effect on the steps.
HWY_INLINE void solve_border(const InteriorPlan& plan, Interior& m) {
  const Vec a = all(plan.decay);
  Border& b = m.border;
  const auto force_of = [&](int i) { return i == plan.border ? 1.0F : i == plan.border + 1 ? -plan.decay : 0.0F; };
  const auto alpha_at = [&](int i, int half, int side) -> Row& {
    return half == 1 ? b.alpha[0][side < 0 ? i - 1 : i] : b.alpha[1][i + side * half / 2];
  };
  for (int i = 0; i < plan.bins; ++i) store(all(force_of(i)) * load(m.leaf[i].bound.beta), b.alpha[0][i]);
  on_way_up(plan.bins, [&](int i, int half) HWY_ATTR {
    const Wavelet& w = m.wavelet[i];
    const Pair left = load(alpha_at(i, half, -1));
    const Pair right = load(alpha_at(i, half, 1));
    const Pair crossed = fma(load(right_of(i, m).beta), left, load(left_of(i, m).beta) * right);
    const Pair pull = load(w.pull);
    store(fma(pull + pull, crossed, load(w.room) * (left + right)), b.alpha[1][i]);
  });
  const Pair total = load(b.alpha[1][plan.bins / 2]);
  const Pair sum_c = load(m.wavelet[0].pull) * total;
  store(load(m.wavelet[0].room) * total, b.step[1][0]);
  store(sum_c, b.c[1][0]);
  store(pair(0.0F) - sum_c, b.c[1][plan.bins / 2]);
  on_way_down(plan.bins, [&](int i, int half) HWY_ATTR {
    const Wavelet& w = m.wavelet[i];
    const Pair y = load(b.c[1][i]);
    const Pair slope = load(left_of(i, m).beta) - load(right_of(i, m).beta);
    const Pair difference = fma(slope, y, load(alpha_at(i, half, -1)) - load(alpha_at(i, half, 1)));
    const Pair c = load(w.pull) * difference;
    store(load(w.room) * difference, b.step[1][i]);
    store(c, b.c[1][i]);
    const std::size_t leaves = half == 1 ? 0 : 1;
    store(y - c, b.c[leaves][half == 1 ? i - 1 : i - half / 2]);
    store(y + c, b.c[leaves][half == 1 ? i : i + half / 2]);
  });
  for (int i = 0; i < plan.bins; ++i) {
    const Pair y = load(b.c[0][i]);
    const Pair step = fma(load(m.leaf[i].bound.beta), y, load(b.alpha[0][i]));
    store(step, b.step[0][i]);
    store(fnma(all(plan.row[static_cast<std::size_t>(i)].diagonal) * load(m.q), step, y + pair(force_of(i))),
          b.c[0][i]);
  }
  const Bound& lost = m.leaf[plan.border].bound;
  const Bound& next = m.leaf[plan.border + 1].bound;
  const Pair missing = fnma(a, load(next.t) + load(next.step), load(lost.t) + load(lost.step));
  const Pair effect = fnma(a, load(b.step[0][plan.border + 1]), load(b.step[0][plan.border]));
  const Pair multiplier = pair(0.0F) - missing / effect;
  for (int i = 0; i < plan.bins; ++i) {
    for (const std::size_t wavelet : {0U, 1U}) {
      Bound& bound = wavelet == 0 ? m.leaf[i].bound : m.wavelet[i].bound;
      store(fma(multiplier, load(b.step[wavelet][i]), load(bound.step)), bound.step);
      store(fma(multiplier, load(b.c[wavelet][i]), load(bound.c)), bound.c);
    }
  }
}

// The largest share of its way to a bound that a whole step would go.
HWY_INLINE Pair reach(float limit, const Bound& b, Pair largest) {
  const Pair step = load(b.step);
  return max(largest, magnitude(step) * rough_reciprocal(fnma(sign(step), load(b.t), pair(limit))));
}

HWY_INLINE void move(Pair part, float limit, Bound& b) {
  const float edge = (1.0F - kEdge) * limit;
  store(clip(fma(part, load(b.step), load(b.t)), all(-edge), all(edge)), b.t);
}

HWY_INLINE void find_step(const InteriorPlan& plan, Interior& m) {
  eliminate(plan, m);
  substitute(plan, m);
  if (plan.border >= 0) solve_border(plan, m);
}

// Moves along the steps as far as all t stay within their bounds.
HWY_INLINE void move(const InteriorPlan& plan, Interior& m) {
  Pair largest = pair(kBack);
  for (int i = 0; i < plan.bins; ++i) {
    const float limit = plan.row[static_cast<std::size_t>(i)].limit;
    largest = reach(plan.bound, m.leaf[i].bound, reach(limit, m.wavelet[i].bound, largest));
  }
  const Pair part = min(all(kBack) * reciprocal(largest), pair(1.0F));
  for (int i = 0; i < plan.bins; ++i) {
    move(part, plan.bound, m.leaf[i].bound);
    move(part, plan.row[static_cast<std::size_t>(i)].limit, m.wavelet[i].bound);
  }
  m.tau = max(m.tau * fnma(all(kFall), part, pair(1.0F)), pair(kLeastTau));
}

// The input in one of the `parts` bins of an interval, of the values less their mean.
HWY_INLINE Pair input_at(const InteriorPlan& plan, const Interior& m, int bin) {
  const int frame = bin / plan.parts;
  const int from_end = plan.parts - 1 - bin % plan.parts;
  Pair x = load(m.wavelet[0].bound.c);
  for (int half = plan.bins / 2; half > 0; half /= 2) {
    const Pair c = load(m.wavelet[(frame & ~(2 * half - 1)) + half].bound.c);
    x = (frame & half) != 0 ? x - c : x + c;
  }
  if (from_end > 1) return load(m.size) * x;
  const Vec within = all(from_end == 0 ? plan.overshoot : -plan.overshoot);
  return load(m.size) * fma(within, load(m.leaf[frame].bound.c), x);
}

// Part of the table in kernels.cpp.
void solve_interior(const InteriorPlan& plan, const PixelRun& run) noexcept {
  Interior m;
  for_each_block(run, [&](std::size_t at, std::size_t count) HWY_ATTR {
    begin(plan, run, at, count, m);
    find_step(plan, m);
    for (int k = 1; k < plan.steps; ++k) {
      move(plan, m);
      find_step(plan, m);
    }
    const Pair sum = load(m.sum);
    const Pair mean = fma(all(plan.inverse_count), sum, sum - sum);  // keeps NaN and infinite samples visible
    const Pair late = fma(all(run.published.weight_after), input_at(plan, m, run.published.after), mean);
    store_pixels(run, fma(all(run.published.weight_before), input_at(plan, m, run.published.before), late), at, count);
  });
}

}  // namespace bolo::deblur::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

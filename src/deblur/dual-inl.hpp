// Coordinate descent with over-relaxation on the dual (dual_plan.hpp). Included once for every instruction set.
//
//   c_i        transform of p times the inverse filter's x
//   t_i        dual variable of Haar coefficient i, times p / gain_i
//   v          H^T of the dual
//   jump[j]    p c (v_{2j-1} - v_{2j}), the jump at the begin of bin 2j; the first and the last are those at the ends
//   of
//              the window. A jump between two bins of a pair moves with its wavelet alone and is not kept.
#if defined(BOLO_DEBLUR_DUAL_INL) == defined(HWY_TARGET_TOGGLE)
#ifdef BOLO_DEBLUR_DUAL_INL
#undef BOLO_DEBLUR_DUAL_INL
#else
#define BOLO_DEBLUR_DUAL_INL
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

inline constexpr float kFar = 1e20F;
// Of a lost sample's value, before the second sweep and before each later one.
inline constexpr int kFirstSteps = 8;
inline constexpr int kLaterSteps = 2;
constexpr std::size_t most_parts(int bins) { return static_cast<std::size_t>(2 * log2_of(bins) + 1); }

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

  DualRun(const DualPlan& the_plan, const PixelRun& run, const Estimate& the_estimate)
      : plan(the_plan), pixels(run), estimate(the_estimate) {
    for (std::size_t s = 0; s <= static_cast<std::size_t>(plan.bins); ++s) {
      put(all(estimate.sample[s]), weight[s]);
    }
    for (std::size_t k = 0; k < estimate.terms; ++k) put(all(estimate.term[k].weight), term[k]);
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

// Moves a lost sample.
template <int kBins>
HWY_INLINE void shift_lost(const LostSample& lost, Vec by, std::size_t v, Dual<kBins>& m) {
  for (std::size_t k = 0; k < lost.parts; ++k) {
    float* const c = m.c[lost.part[k].row] + v;
    put(hn::MulAdd(all(lost.part[k].move), by, at(c)), c);
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
  for (std::size_t k = 0; k < plan.lost; ++k) {
    const LostSample& lost = plan.gap[k];
    const Vec rise = hn::Sub(load_vector_of(planes[lost.after] + pixel), load_vector_of(planes[lost.slot] + pixel));
    shift_lost(lost, hn::Mul(all(lost.weight), rise), v, m);
  }
}

template <typename T, int kBins>
HWY_INLINE void load_pixels(const DualRun& run, std::size_t first, std::size_t count, Dual<kBins>& m) {
  constexpr std::size_t kSlots = kBins + 1;
  const T* planes[kSlots];
  for (std::size_t s = 0; s < kSlots; ++s) {
    planes[s] = static_cast<const T*>(run.pixels.planes[run.plan.stand_in[s]]) + first;
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
HWY_INLINE void load_block(const DualRun& run, std::size_t first, Dual<kBins>& m) {
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

// What an update needs besides the pixel's own values.
struct Weights {
  Vec keep;
  Vec left;
  Vec right;
  Vec twice;
  std::size_t bound;
};

// `level`: log2 of the coefficient's support, less 1.
HWY_INLINE Weights weights_of(const DualPlan& plan, int i, int level) {
  const DualCoefficients& row = plan.row[static_cast<std::size_t>(i)];
  return {all(row.keep), all(row.left), all(row.right), all(2.0F * row.right), bound_of(i, level)};
}

// One coefficient; returns how far it moved. In the first sweep t is still zero.
template <bool kFirst, int kBins>
HWY_INLINE Vec move(const Weights& w, int i, Vec pull, std::size_t v, Dual<kBins>& m) {
  const Vec old = kFirst ? hn::Zero(Float()) : at(m.t(i) + v);
  const Vec rest = kFirst ? at(m.c[i] + v) : hn::MulAdd(w.keep, old, at(m.c[i] + v));
  const Vec next = clip(hn::Add(rest, pull), m.low[w.bound] + v, m.high[w.bound] + v);
  put(next, m.t(i) + v);
  return kFirst ? next : hn::Sub(next, old);
}

// Moves a wavelet and the jumps at its ends and, where it is kept, in its middle.
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
  middle = kFirst ? hn::Mul(w.twice, moved) : hn::MulAdd(w.twice, moved, middle);
  right = hn::NegMulAdd(w.right, moved, right);
}

// The wavelets of kTree neighbouring stretches of kStride bins; their jumps stay in registers.
template <int kBins, int kTree, int kStride, bool kFirst>
HWY_INLINE void sweep_tree(const DualPlan& plan, int begin, Dual<kBins>& m) {
  constexpr int kLevel = log2_of(kTree * kStride) - 1;
  const int middle = begin + kTree / 2 * kStride;
  float* const left_jump = m.jump(begin);
  float* const right_jump = m.jump(begin + kTree * kStride);
  const Weights coarse = weights_of(plan, middle, kLevel);
  if constexpr (kTree == 2) {
    for (std::size_t v = 0; v < m.end; v += kLanes) {
      Vec left = at(left_jump + v);
      Vec right = at(right_jump + v);
      if constexpr (kStride == 1) {
        move_wavelet<kFirst>(coarse, middle, v, m, left, right);
      } else {
        Vec inner = kFirst ? left : at(m.jump(middle) + v);
        move_wavelet<kFirst>(coarse, middle, v, m, left, inner, right);
        put(inner, m.jump(middle) + v);
      }
      put(left, left_jump + v);
      put(right, right_jump + v);
    }
  } else {
    const Weights near = weights_of(plan, middle - kStride, kLevel - 1);
    const Weights far = weights_of(plan, middle + kStride, kLevel - 1);
    for (std::size_t v = 0; v < m.end; v += kLanes) {
      Vec left = at(left_jump + v);
      Vec right = at(right_jump + v);
      Vec inner = kFirst ? left : at(m.jump(middle) + v);
      move_wavelet<kFirst>(coarse, middle, v, m, left, inner, right);
      if constexpr (kStride == 1) {
        move_wavelet<kFirst>(near, middle - kStride, v, m, left, inner);
        move_wavelet<kFirst>(far, middle + kStride, v, m, inner, right);
      } else {
        float* const near_jump = m.jump(middle - kStride) + v;
        float* const far_jump = m.jump(middle + kStride) + v;
        Vec near_inner = kFirst ? left : at(near_jump);
        Vec far_inner = kFirst ? left : at(far_jump);
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

// The trees of one size over the window, every other one first: neighbours wait for each other's jumps.
template <int kBins, int kSpan, int kTree, bool kFirst>
HWY_INLINE void sweep_levels(const DualPlan& plan, Dual<kBins>& m) {
  constexpr int kStride = kSpan / kTree;
  HWY_UNROLL(4)
  for (int begin = 0; begin < kBins; begin += 2 * kSpan) sweep_tree<kBins, kTree, kStride, kFirst>(plan, begin, m);
  HWY_UNROLL(4)
  for (int begin = kSpan; begin < kBins; begin += 2 * kSpan) sweep_tree<kBins, kTree, kStride, kFirst>(plan, begin, m);
  if constexpr (kStride > 1) sweep_levels<kBins, kStride, 4, kFirst>(plan, m);
}

// Only the trees that hold the bins which are published.
template <int kBins, int kSpan, int kTree>
HWY_INLINE void sweep_near_levels(const DualPlan& plan, const Published& bins, Dual<kBins>& m) {
  constexpr int kStride = kSpan / kTree;
  for (int begin = bins.before / kSpan * kSpan; begin <= bins.after; begin += kSpan) {
    sweep_tree<kBins, kTree, kStride, false>(plan, begin, m);
  }
  if constexpr (kStride > 1) sweep_near_levels<kBins, kStride, 4>(plan, bins, m);
}

// The coefficient that is constant over the window: it has no middle.
template <int kBins, bool kFirst>
HWY_INLINE void sweep_sum(const DualPlan& plan, Dual<kBins>& m) {
  const Weights w = weights_of(plan, 0, log2_of(kBins) - 1);
  for (std::size_t v = 0; v < m.end; v += kLanes) {
    const Vec begin = kFirst ? hn::Zero(Float()) : at(m.jump(0) + v);
    const Vec end = kFirst ? hn::Zero(Float()) : at(m.jump(kBins) + v);
    const Vec moved = move<kFirst>(w, 0, hn::Sub(begin, end), v, m);
    put(hn::NegMulAdd(w.left, moved, begin), m.jump(0) + v);
    put(hn::MulAdd(w.right, moved, end), m.jump(kBins) + v);
  }
}

template <int kBins>
constexpr int first_tree() {
  return log2_of(kBins) % 2 == 1 ? 2 : 4;
}

template <int kBins, bool kFirst>
HWY_INLINE void sweep(const DualPlan& plan, Dual<kBins>& m) {
  sweep_sum<kBins, kFirst>(plan, m);
  sweep_levels<kBins, kBins, first_tree<kBins>(), kFirst>(plan, m);
}

template <int kBins>
HWY_INLINE void sweep_near(const DualPlan& plan, const Published& bins, Dual<kBins>& m) {
  sweep_sum<kBins, false>(plan, m);
  sweep_near_levels<kBins, kBins, first_tree<kBins>()>(plan, bins, m);
}

// Where a coefficient's t would go without its bound.
template <int kBins>
HWY_INLINE Vec unbounded(const DualPlan& plan, int i, std::size_t v, Dual<kBins>& m) {
  const Vec rest = hn::MulAdd(all(plan.row[static_cast<std::size_t>(i)].keep), at(m.t(i) + v), at(m.c[i] + v));
  if (i == 0) return hn::Add(rest, hn::Sub(at(m.jump(0) + v), at(m.jump(kBins) + v)));
  const int half = i & -i;
  const Vec ends = hn::Add(at(m.jump(i - half) + v), at(m.jump(i + half) + v));
  return hn::Add(rest, half == 1 ? ends : hn::NegMulAdd(all(2.0F), at(m.jump(i) + v), ends));
}

// What the steps of a lost sample need: where t would go, how far the sample has moved, and between which bounds.
template <int kBins>
struct Step {
  using Wide = typename Dual<kBins>::Wide;
  HWY_ALIGN Wide rest[most_parts(kBins)];
  HWY_ALIGN Wide others;  // the equation's terms that hardly follow
  HWY_ALIGN Wide y;
  HWY_ALIGN Wide low;
  HWY_ALIGN Wide high;
};

template <bool kFirst, int kBins>
HWY_INLINE void begin_step(const DualPlan& plan, const LostSample& lost, std::size_t v, Dual<kBins>& m,
                           Step<kBins>& s) {
  Vec others = hn::Zero(Float());
  for (std::size_t k = lost.led; k < lost.parts; ++k) {
    others = hn::MulAdd(all(lost.part[k].share), at(m.t(lost.part[k].row) + v), others);
  }
  put(others, s.others + v);
  Vec low = kFirst ? all(kFar) : all(-kFar);
  Vec high = hn::Neg(low);
  for (std::size_t k = 0; k < lost.led; ++k) {
    const LostSample::Part& part = lost.part[k];
    const Vec rest = unbounded(plan, part.row, v, m);
    put(rest, s.rest[k] + v);
    if (!kFirst) continue;
    const Vec middle = hn::Mul(all(-part.inverse), rest);
    const Vec width = hn::Mul(all(std::abs(part.inverse)), at(m.high[part.bound] + v));
    low = hn::Min(low, hn::Sub(middle, width));
    high = hn::Max(high, hn::Add(middle, width));
  }
  put(low, s.low + v);
  put(high, s.high + v);
  put(kFirst ? hn::Min(hn::Max(hn::Zero(Float()), low), high) : hn::Zero(Float()), s.y + v);
}

// A step of Newton's method between the bounds; half-way between them where it leads out or no t is free to follow.
template <int kBins>
HWY_INLINE void newton(const LostSample& lost, std::size_t v, const Dual<kBins>& m, Step<kBins>& s) {
  const Vec y = at(s.y + v);
  Vec sum = at(s.others + v);
  Vec slope = hn::Zero(Float());
  for (std::size_t k = 0; k < lost.led; ++k) {
    const LostSample::Part& part = lost.part[k];
    const Vec to = hn::MulAdd(all(part.move), y, at(s.rest[k] + v));
    const Vec t = clip(to, m.low[part.bound] + v, m.high[part.bound] + v);
    sum = hn::MulAdd(all(part.share), t, sum);
    slope = hn::Add(slope, hn::IfThenElseZero(hn::Eq(to, t), all(part.slope)));
  }
  const auto above = hn::Gt(sum, hn::Zero(Float()));
  const Vec high = hn::IfThenElse(above, y, at(s.high + v));
  const Vec low = hn::IfThenElse(above, at(s.low + v), y);
  put(high, s.high + v);
  put(low, s.low + v);
  const Vec next = hn::Sub(y, hn::Div(sum, slope));  // 0 / 0 and 1 / 0 are not between the bounds
  const auto inside = hn::And(hn::Ge(next, low), hn::Le(next, high));
  const auto bounded = hn::Lt(hn::Sub(high, low), all(kFar));
  const Vec halfway = hn::IfThenElse(bounded, hn::Mul(all(0.5F), hn::Add(low, high)), y);
  put(hn::IfThenElse(inside, next, halfway), s.y + v);
}

// Moves the lost samples to where the next sweep would keep their equations: from anywhere the first time.
template <bool kFirst, int kBins>
HWY_INLINE void balance(const DualPlan& plan, Dual<kBins>& m) {
  Step<kBins> s;
  for (std::size_t k = 0; k < plan.lost; ++k) {
    const LostSample& lost = plan.gap[k];
    for (std::size_t v = 0; v < m.end; v += kLanes) begin_step<kFirst>(plan, lost, v, m, s);
    for (int step = 0; step < (kFirst ? kFirstSteps : kLaterSteps); ++step) {
      for (std::size_t v = 0; v < m.end; v += kLanes) newton(lost, v, m, s);
    }
    for (std::size_t v = 0; v < m.end; v += kLanes) shift_lost(lost, at(s.y + v), v, m);
  }
}

// What the estimate takes of t and of the jumps.
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

// Calls finish(first pixel, memory) for each part of the run, its dual near the optimum.
template <int kBins, typename Finish>
HWY_INLINE void for_each_dual(const DualRun& run, const Finish& finish) {
  Dual<kBins> m;
  if (run.pixels.lambda == nullptr) {
    for (std::size_t v = 0; v < Dual<kBins>::kPixels; v += kLanes) set_bounds(run.plan, v, all(run.plan.lambda), m);
  }
  for (std::size_t first = run.pixels.begin; first < run.pixels.end; first += Dual<kBins>::kPixels) {
    load_block(run, first, m);
    sweep<kBins, true>(run.plan, m);
    for (int k = 1; k < run.plan.sweeps; ++k) {
      k == 1 ? balance<true>(run.plan, m) : balance<false>(run.plan, m);
      sweep<kBins, false>(run.plan, m);
    }
    for (int k = 0; k < run.plan.near_sweeps; ++k) sweep_near(run.plan, run.pixels.published, m);
    finish(first, m);
  }
}

template <int kBins>
void dual_run(const DualPlan& plan, const PixelRun& pixels) {
  const Estimate estimate = dual_estimate(plan, pixels.published);
  const DualRun run(plan, pixels, estimate);
  for_each_dual<kBins>(run, [&](std::size_t first, Dual<kBins>& m) HWY_ATTR { finish_dual(run, first, m); });
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
  with_bins(plan.bins, [&](auto bins) { dual_run<decltype(bins)::value>(plan, run); });
}

}  // namespace bolo::deblur::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();
#endif

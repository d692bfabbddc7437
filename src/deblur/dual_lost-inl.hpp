// Moves lost samples between sweeps (LostSample in dual_plan.hpp). Included once for every instruction set.
#if defined(BOLO_DEBLUR_DUAL_LOST_INL) == defined(HWY_TARGET_TOGGLE)
#ifdef BOLO_DEBLUR_DUAL_LOST_INL
#undef BOLO_DEBLUR_DUAL_LOST_INL
#else
#define BOLO_DEBLUR_DUAL_LOST_INL
#endif

#include "src/deblur/dual_state-inl.hpp"

HWY_BEFORE_NAMESPACE();
namespace bolo::deblur::HWY_NAMESPACE {

inline constexpr int kLast = 1000;     // after the last sweep
inline constexpr int kMostSteps = 20;  // along the line of a lost sample's value
inline constexpr float kFar = 1e20F;

// Addresses of a part's (LostMove::Part) values, by pixel.
struct PartRows {
  const float* t;
  float* c;
  const float* begin;
  const float* middle;
  const float* end;
  const float* low;
  const float* high;
  float keep;
  float twice;  // 2 if the part has a middle

  // The next value of t before clipping.
  HWY_INLINE Vec unbounded(std::size_t v) const {
    const Vec rest = hn::MulAdd(all(keep), at(t + v), at(c + v));
    return hn::Add(rest, hn::NegMulAdd(all(twice), at(middle + v), hn::Add(at(begin + v), at(end + v))));
  }
};

// State of the line search over lost samples' values, for a few vectors of pixels: y, the position on the line; its
// bracket [low, high]; for each t its unclipped value at y = 0 (rest) and its slope over y (move).
template <int kBins>
struct Steps {
  static constexpr std::size_t kPixels = std::min(2 * kLanes, Dual<kBins>::kPixels);
  static constexpr std::size_t kVectors = kPixels / kLanes;
  static constexpr std::size_t kParts = 4 * log2_of(kBins);
  using Wide = float[kPixels];
  PartRows part[kParts];
  HWY_ALIGN Wide rest[kParts];
  HWY_ALIGN Wide move[kParts];
  HWY_ALIGN Wide estimate;
  HWY_ALIGN Wide tolerance;
  HWY_ALIGN Wide y;
  HWY_ALIGN Wide low;
  HWY_ALIGN Wide high;

  Steps(const DualPlan& plan, const LostMove& lost, Dual<kBins>& m) {
    for (std::size_t k = 0; k < lost.parts; ++k) {
      const int i = lost.part[k].row;
      const std::size_t bound = lost.part[k].bound;
      const int half = i == 0 ? kBins : i & -i;
      float* const end = m.jump(i == 0 ? kBins : i + half);
      const bool kept = half > 1;  // the sum's end serves as its middle
      part[k] = {m.t(i),
                 m.c[i],
                 m.jump(i == 0 ? 0 : i - half),
                 i == 0 || !kept ? end : m.jump(i),
                 end,
                 m.low[bound],
                 m.high[bound],
                 plan.row[static_cast<std::size_t>(i)].keep,
                 kept ? 2.0F : 0.0F};
    }
  }
};

// Slope of a part's t over y.
template <bool kTwo, int kBins>
HWY_INLINE Vec move_of(const LostMove& lost, std::size_t k, std::size_t v, const Steps<kBins>& s) {
  return kTwo ? at(s.move[k] + v) : all(lost.part[k].move);
}

// Starts at the sample's present value or, the first time, at the median zero of the three parts of largest weight.
template <int kBins>
HWY_INLINE bool begin_one(const DualRun& run, const LostMove& lost, bool first, std::size_t from, std::size_t v,
                          const Dual<kBins>& m, Steps<kBins>& s) {
  Vec y = hn::Zero(Float());
  if (first && lost.parts >= 3) {
    const auto middle = [&](std::size_t k) HWY_ATTR { return hn::Mul(all(lost.part[k].inverse), at(s.rest[k] + v)); };
    const Vec a = middle(0);
    const Vec b = middle(1);
    y = hn::Max(hn::Min(a, b), hn::Min(hn::Max(a, b), middle(2)));
  }
  put(y, s.y + v);
  put(all(-kFar), s.low + v);
  put(all(run.lost[lost.first]), s.estimate + v);
  put(hn::Mul(all(lost.tolerance), at(m.high[lost.part[0].bound] + from + v)), s.tolerance + v);
  return true;
}

// Starts at Newton's step for two samples, which gives the line's direction; only t within their bounds count in
// slopes. Pixels whose equations hold are not moved. Returns false if all hold.
template <int kBins>
HWY_INLINE bool begin_two(const DualRun& run, const LostMove& lost, std::size_t from, std::size_t v,
                          const Dual<kBins>& m, Steps<kBins>& s) {
  Vec sum = hn::Zero(Float());
  Vec other_sum = hn::Zero(Float());
  Vec slope = all(lost.slopes[0]);
  Vec both_slope = all(lost.slopes[1]);
  Vec other_slope = all(lost.slopes[2]);
  for (std::size_t k = 0; k < lost.parts; ++k) {
    const LostMove::Part& part = lost.part[k];
    const Vec to = at(s.rest[k] + v);
    const Vec t = clip(to, m.low[part.bound] + from + v, m.high[part.bound] + from + v);
    const Vec share = hn::Mul(all(part.share), t);
    sum = hn::MulAdd(all(part.move), share, sum);
    other_sum = hn::MulAdd(all(part.other), share, other_sum);
    const Vec free = hn::IfThenElseZero(hn::Eq(to, t), all(part.share));
    const Vec free_move = hn::Mul(all(part.move), free);
    slope = hn::MulAdd(all(part.move), free_move, slope);
    both_slope = hn::MulAdd(all(part.other), free_move, both_slope);
    other_slope = hn::MulAdd(hn::Mul(all(part.other), free), all(part.other), other_slope);
  }
  const Vec tolerance = hn::Mul(all(lost.tolerance), at(m.high[lost.part[0].bound] + from + v));
  const auto off = hn::Gt(hn::Max(hn::Abs(sum), hn::Abs(other_sum)), tolerance);
  const Vec first = hn::MulSub(both_slope, other_sum, hn::Mul(other_slope, sum));
  const Vec second = hn::MulSub(both_slope, sum, hn::Mul(slope, other_sum));
  const Vec determinant = hn::MulSub(slope, other_slope, hn::Mul(both_slope, both_slope));
  for (std::size_t k = 0; k < lost.parts; ++k) {
    put(hn::MulAdd(all(lost.part[k].move), first, hn::Mul(all(lost.part[k].other), second)), s.move[k] + v);
  }
  put(hn::IfThenElseZero(off, hn::Div(all(1.0F), determinant)), s.y + v);
  put(hn::Zero(Float()), s.low + v);
  put(hn::MulAdd(all(run.lost[lost.first]), first, hn::Mul(all(run.lost[lost.second]), second)), s.estimate + v);
  const Vec along = hn::Mul(tolerance, hn::Add(hn::Abs(first), hn::Abs(second)));
  put(hn::IfThenElse(off, along, all(kFar)), s.tolerance + v);
  return !hn::AllFalse(Float(), off);
}

// A zero of a part's t between y and the bracket's end: the nearest, for two samples a weighted mean, else the middle.
template <bool kTwo, int kBins>
HWY_INLINE Vec hop(const LostMove& lost, hn::Mask<Float> below, std::size_t v, const Steps<kBins>& s) {
  const Vec y = at(s.y + v);
  const Vec low = at(s.low + v);
  const Vec high = at(s.high + v);
  const Vec end = hn::IfThenElse(below, low, high);
  Vec next = end;
  Vec weight = hn::Zero(Float());
  Vec sum = hn::Zero(Float());
  for (std::size_t k = 0; k < lost.parts; ++k) {
    const Vec move = move_of<kTwo>(lost, k, v, s);
    const Vec rest = at(s.rest[k] + v);
    if constexpr (kTwo) {
      const Vec sides = hn::Mul(hn::MulAdd(move, y, rest), hn::MulAdd(move, end, rest));
      const Vec between = hn::IfThenElseZero(hn::Lt(sides, hn::Zero(Float())), move);
      weight = hn::MulAdd(between, move, weight);
      sum = hn::MulAdd(between, rest, sum);
    } else {
      const Vec middle = hn::Mul(all(lost.part[k].inverse), rest);
      const Vec down = hn::IfThenElse(hn::Lt(middle, y), hn::Max(next, middle), next);
      const Vec up = hn::IfThenElse(hn::Gt(middle, y), hn::Min(next, middle), next);
      next = hn::IfThenElse(below, down, up);
    }
  }
  if constexpr (kTwo) next = hn::Neg(hn::Div(sum, weight));  // 0 / 0 is not between the bounds
  const auto bounded = hn::Lt(hn::Sub(high, low), all(kFar));
  const Vec halfway = hn::IfThenElse(bounded, hn::Mul(all(0.5F), hn::Add(low, high)), y);
  return hn::IfThenElse(hn::And(hn::Gt(next, low), hn::Lt(next, high)), next, halfway);
}

// A Newton step for the pixels from `from` on; hop() replaces a step that leaves the bracket or has slope 0. Pixels
// whose equation holds are not moved. Returns false if all hold.
template <bool kTwo, int kBins>
HWY_INLINE bool step(const LostMove& lost, std::size_t from, Steps<kBins>& s) {
  constexpr std::size_t kVectors = Steps<kBins>::kVectors;
  Vec sum[kVectors];
  Vec slope[kVectors];
  HWY_UNROLL(2) for (std::size_t n = 0; n < kVectors; ++n) sum[n] = slope[n] = hn::Zero(Float());
  for (std::size_t k = 0; k < lost.parts; ++k) {
    const LostMove::Part& part = lost.part[k];
    const float* const low = s.part[k].low + from;
    const float* const high = s.part[k].high + from;
    HWY_UNROLL(2) for (std::size_t n = 0; n < kVectors; ++n) {
      const std::size_t v = n * kLanes;
      const Vec move = move_of<kTwo>(lost, k, v, s);
      const Vec to = hn::MulAdd(move, at(s.y + v), at(s.rest[k] + v));
      const Vec t = clip(to, low + v, high + v);
      const Vec pull = kTwo ? hn::Mul(all(part.share), move) : all(part.pull);
      const Vec free = kTwo ? hn::Mul(pull, move) : all(part.slope);
      sum[n] = hn::MulAdd(pull, t, sum[n]);
      slope[n] = hn::Add(slope[n], hn::IfThenElseZero(hn::Eq(to, t), free));
    }
  }
  bool any = false;
  HWY_UNROLL(2) for (std::size_t n = 0; n < kVectors; ++n) {
    const std::size_t v = n * kLanes;
    const auto off = hn::Gt(hn::Abs(sum[n]), at(s.tolerance + v));
    if (hn::AllFalse(Float(), off)) continue;
    any = true;
    const Vec y = at(s.y + v);
    const auto above = hn::Gt(sum[n], hn::Zero(Float()));
    const Vec high = hn::IfThenElse(above, y, at(s.high + v));
    const Vec low = hn::IfThenElse(above, at(s.low + v), y);
    put(high, s.high + v);
    put(low, s.low + v);
    Vec next = hn::Sub(y, hn::Div(sum[n], slope[n]));  // 0 / 0 and 1 / 0 are not between the bounds
    const auto inside = hn::And(hn::Gt(next, low), hn::Lt(next, high));
    if (!hn::AllTrue(Float(), hn::Or(inside, hn::Not(off)))) {
      next = hn::IfThenElse(inside, next, hop<kTwo>(lost, above, v, s));
    }
    put(hn::IfThenElse(off, next, y), s.y + v);
  }
  return any;
}

// Moves a lost sample, or two, to the values at which sweep `next` would satisfy their equations.
template <bool kTwo, int kBins>
HWY_INLINE void solve_lost(const DualRun& run, const LostMove& lost, int next, Dual<kBins>& m) {
  const bool first = next == run.plan.first_balance;
  Steps<kBins> s(run.plan, lost, m);
  // Unused vectors of the last group hold stale values, which is harmless.
  for (std::size_t from = 0; from < m.end; from += Steps<kBins>::kPixels) {
    for (std::size_t k = 0; k < lost.parts; ++k) {
      const PartRows& part = s.part[k];
      for (std::size_t v = 0; v < Steps<kBins>::kPixels; v += kLanes) {
        put(next == 0 ? at(part.c + from + v) : part.unbounded(from + v), s.rest[k] + v);
      }
    }
    for (int round = 0; round < (kTwo ? kMostRounds : 1); ++round) {
      bool off = false;
      for (std::size_t v = 0; v < Steps<kBins>::kPixels; v += kLanes) {
        put(all(kFar), s.high + v);
        off |= kTwo ? begin_two(run, lost, from, v, m, s) : begin_one(run, lost, first, from, v, m, s);
      }
      if (!off) break;
      for (int k = 0; k < kMostSteps && step<kTwo>(lost, from, s); ++k) {
      }
      for (std::size_t k = 0; k < lost.parts; ++k) {
        float* const c = s.part[k].c + from;
        for (std::size_t v = 0; v < Steps<kBins>::kPixels; v += kLanes) {
          const Vec moved = hn::Mul(move_of<kTwo>(lost, k, v, s), at(s.y + v));
          put(hn::Add(moved, at(c + v)), c + v);
          if (kTwo) put(hn::Add(moved, at(s.rest[k] + v)), s.rest[k] + v);
        }
      }
      for (std::size_t v = 0; v < Steps<kBins>::kPixels; v += kLanes) {
        put(hn::MulAdd(at(s.estimate + v), at(s.y + v), at(m.estimate + from + v)), m.estimate + from + v);
      }
    }
  }
}

// Sets t of a pair's wavelet from the lost sample's equation, and the sample to the value that keeps t there.
template <int kBins>
HWY_INLINE void solve_pair(const DualRun& run, const LostMove& lost, Dual<kBins>& m) {
  constexpr std::size_t kParts = log2_of(kBins) + 1;
  const int i = lost.part[0].row;
  const DualCoefficients& row = run.plan.row[static_cast<std::size_t>(i)];
  const Vec keep = all(row.keep);
  const Vec to_left = all(row.left);
  const Vec to_right = all(row.right);
  for (std::size_t v = 0; v < m.end; v += kLanes) {
    Vec t = hn::Zero(Float());
    HWY_UNROLL(6) for (std::size_t k = 1; k < kParts; ++k) {
      t = hn::MulAdd(all(lost.part[k].share), at(m.t(lost.part[k].row) + v), t);
    }
    const Vec moved = hn::Sub(t, at(m.t(i) + v));
    const Vec left = hn::NegMulAdd(to_left, moved, at(m.jump(i - 1) + v));
    const Vec right = hn::NegMulAdd(to_right, moved, at(m.jump(i + 1) + v));
    put(t, m.t(i) + v);
    put(left, m.jump(i - 1) + v);
    put(right, m.jump(i + 1) + v);
    const Vec rest = hn::Add(hn::MulAdd(keep, t, at(m.c[i] + v)), hn::Add(left, right));
    const Vec by = hn::Mul(all(lost.part[0].inverse), hn::Sub(rest, t));
    HWY_UNROLL(7) for (std::size_t k = 0; k < kParts; ++k) {
      float* const c = m.c[lost.part[k].row] + v;
      put(hn::MulAdd(all(lost.part[k].move), by, at(c)), c);
    }
    put(hn::MulAdd(all(run.lost[lost.first]), by, at(m.estimate + v)), m.estimate + v);
  }
}

}  // namespace bolo::deblur::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();
#endif

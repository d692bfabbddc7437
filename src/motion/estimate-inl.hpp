// The estimate along the motion. Included once for every instruction set.
#if defined(BOLO_MOTION_ESTIMATE_INL) == defined(HWY_TARGET_TOGGLE)
#ifdef BOLO_MOTION_ESTIMATE_INL
#undef BOLO_MOTION_ESTIMATE_INL
#else
#define BOLO_MOTION_ESTIMATE_INL
#endif

#include <algorithm>
#include <cmath>

#include "src/motion/block-inl.hpp"
#include "src/motion/interpolation.hpp"

HWY_BEFORE_NAMESPACE();
namespace bolo::motion::HWY_NAMESPACE {

// Sources and weights of kLanes blocks side by side, each displaced by its d.
struct CubicMoves {
  HWY_ALIGN float across[4][kLanes];
  HWY_ALIGN float down[4][kLanes];
  HWY_ALIGN std::int32_t x[kLanes];  // whole parts, limited as in whole_of
  HWY_ALIGN std::int32_t y[kLanes];
  HWY_ALIGN float whole[kLanes];  // 1 where a block's whole source keeps the margin from the border

  HWY_INLINE void find(const PaddedPlane& a, int c, int y0, const Vec2* d, float margin) {
    HWY_ALIGN float dx[kLanes] = {};
    HWY_ALIGN float dy[kLanes] = {};
    for (int i = 0; i < std::min(a.blocks_across() - c, kLanes); ++i) {
      dx[i] = d[c + i].x;
      dy[i] = d[c + i].y;
    }
    const Geometry g = a.geometry();
    const Vec left = hn::MulAdd(all(kBlock), count_from(0.0F), all(static_cast<float>(c * kBlock)));
    const Vec top = all(static_cast<float>(y0));
    const auto inside = hn::And(along(dx, left, a.blocks_across(), g.width, margin, across, x),
                                along(dy, top, a.blocks_down(), g.height, margin, down, y));
    hn::Store(hn::IfThenElseZero(inside, all(1.0F)), Float(), whole);
  }

 private:
  // Along one axis, for blocks that begin at `first`. Returns where the margin is kept, like Inside::whole.
  static HWY_INLINE hn::Mask<Float> along(const float* by, Vec first, int blocks, int pixels, float margin,
                                          float (*weights)[kLanes], std::int32_t* to) {
    const Vec d = hn::Load(Float(), by);
    const Vec floor = hn::Floor(hn::Neg(d));
    const Vec f = hn::Sub(hn::Neg(d), floor);
    const Vec low = hn::Sub(all(lowest(0)), first);
    const Vec limited = hn::Min(hn::Max(floor, low), hn::Sub(all(highest(0, blocks)), first));
    hn::Store(hn::ConvertTo(hn::RebindToSigned<Float>(), limited), hn::RebindToSigned<Float>(), to);
    const Vec w[] = {cubic_far(hn::Add(f, all(1.0F))), cubic_near(f), cubic_near(hn::Sub(all(1.0F), f))};
    Vec rest = all(1.0F);
    for (int k = 0; k < 3; ++k) {
      hn::Store(w[k], Float(), weights[k]);
      rest = hn::Sub(rest, w[k]);
    }
    hn::Store(rest, Float(), weights[3]);
    const Vec begin = hn::Max(hn::Add(d, all(margin)), hn::Zero(Float()));
    const Vec end = hn::Add(hn::Min(hn::Sub(d, all(margin)), hn::Zero(Float())), all(static_cast<float>(pixels - 1)));
    return hn::And(hn::Ge(first, begin), hn::Le(hn::Add(first, all(kBlock - 1)), end));
  }
  static HWY_INLINE Vec cubic_far(Vec t) {
    return hn::MulAdd(hn::MulAdd(hn::MulAdd(all(kKeys), t, all(-5 * kKeys)), t, all(8 * kKeys)), t, all(-4 * kKeys));
  }
  static HWY_INLINE Vec cubic_near(Vec t) {
    return hn::MulAdd(hn::Mul(hn::MulAdd(all(kKeys + 2), t, all(-kKeys - 3)), t), t, all(1.0F));
  }
};

// put(value, row, column) for every vector of block i of `moves`, which is at (x0, y0).
template <typename Put>
HWY_INLINE void move_cubic(const PaddedPlane& a, int x0, int y0, const CubicMoves& moves, int i, const Put& put) {
  const float* from = a.at(x0 + moves.x[i] - 1, y0 + moves.y[i] - 1);
  prefetch_next(from, a.stride(), kBlock + 3);
  Vec wx[4];
  Vec wy[4];
  for (int k = 0; k < 4; ++k) {
    wx[k] = all(moves.across[k][i]);
    wy[k] = all(moves.down[k][i]);
  }
  for (int x = 0; x < kBlock; x += kLanes) {
    const auto across = [&](int r) HWY_ATTR {
      const float* p = from + r * a.stride() + x;
      Vec v = hn::Mul(wx[0], load(p));
      for (int k = 1; k < 4; ++k) v = hn::MulAdd(wx[k], load(p + k), v);
      return v;
    };
    Vec rows[4] = {across(0), across(1), across(2)};
    HWY_UNROLL(8)
    for (int r = 0; r < kBlock; ++r) {
      rows[(r + 3) % 4] = across(r + 3);
      Vec v = hn::Mul(wy[0], rows[r % 4]);
      for (int k = 1; k < 4; ++k) v = hn::MulAdd(wy[k], rows[(r + k) % 4], v);
      put(v, r, x);
    }
  }
}

// Several planes, each displaced onto a row of blocks; block by block, from `first` on.
class MovedPlanes {
 public:
  HWY_INLINE MovedPlanes(const PaddedPlane* const* planes, const Vec2* const* d, int count, float margin, int first,
                         int y0)
      : planes_(planes), d_(d), count_(count), margin_(margin), column_(first), y0_(y0) {
    find();
  }
  HWY_INLINE void go_on() {
    ++column_;
    if (++i_ == kLanes) find();
  }
  // True if all planes cover the block and the margin.
  HWY_INLINE bool all_see() const {
    bool whole = true;
    for (int k = 0; k < count_; ++k) whole = whole && moves_[k].whole[i_] != 0.0F;
    return whole;
  }
  int count() const { return count_; }
  template <typename Put>
  HWY_INLINE void move(int k, const Put& put) const {
    move_cubic(*planes_[k], column_ * kBlock, y0_, moves_[k], i_, put);
  }

 private:
  HWY_INLINE void find() {
    i_ = 0;
    for (int k = 0; k < count_; ++k) moves_[k].find(*planes_[k], column_, y0_, d_[k], margin_);
  }

  const PaddedPlane* const* planes_;
  const Vec2* const* d_;
  int count_;
  float margin_;
  int column_;
  int y0_;
  int i_ = 0;  // index of the block in moves_
  CubicMoves moves_[kPast];
};

struct BlockSum {
  Vec row[kBlock][kBlock / kLanes];

  HWY_INLINE BlockSum() { std::fill_n(&row[0][0], sizeof(row) / sizeof(Vec), hn::Zero(Float())); }
};

// Sum of planes that all cover the whole block.
HWY_INLINE void add_moved(const MovedPlanes& moved, BlockSum& sum) {
  for (int k = 0; k < moved.count(); ++k) {
    moved.move(k, [&](Vec v, int r, int x) HWY_ATTR { sum.row[r][x / kLanes] = hn::Add(sum.row[r][x / kLanes], v); });
  }
}

// Mean of the planes at a block that some do not cover; `otherwise` where none does.
HWY_NOINLINE void align_seen(const MovedPlanes& moved, const Vec2* const* d, const PaddedPlane& otherwise, int x0,
                             int y0, PaddedPlane& out) {
  HWY_ALIGN float total[kBlock * kBlock] = {};
  HWY_ALIGN float seen[kBlock * kBlock] = {};
  for (int k = 0; k < moved.count(); ++k) {
    const Inside inside(otherwise.geometry(), d[k][x0 / kBlock], 0.0F);
    moved.move(k, [&](Vec v, int r, int x) HWY_ATTR {
      if (!inside.row(y0 + r)) return;
      const Vec in = inside.mask(x0 + x);
      store(hn::MulAdd(in, v, load(total + r * kBlock + x)), total + r * kBlock + x);
      store(hn::Add(in, load(seen + r * kBlock + x)), seen + r * kBlock + x);
    });
  }
  for (int r = 0; r < kBlock; ++r) {
    for (int x = 0; x < kBlock; x += kLanes) {
      const Vec n = load(seen + r * kBlock + x);
      const Vec mean = hn::Div(load(total + r * kBlock + x), hn::Max(n, all(1.0F)));
      store(hn::IfThenElse(hn::Gt(n, hn::Zero(Float())), mean, load(otherwise.at(x0 + x, y0 + r))),
            out.at(x0 + x, y0 + r));
    }
  }
}

void align(const PaddedPlane* const* planes, const Vec2* const* d, int count, const PaddedPlane& now, int block_row,
           PaddedPlane& out) noexcept {
  const int y0 = block_row * kBlock;
  const Vec every = all(static_cast<float>(count));
  MovedPlanes moved(planes, d, count, 0.0F, 0, y0);
  for (int x0 = 0; x0 < now.blocks_across() * kBlock; x0 += kBlock, moved.go_on()) {
    if (!moved.all_see()) {
      align_seen(moved, d, now, x0, y0, out);
      continue;
    }
    BlockSum sum;
    add_moved(moved, sum);
    for (int r = 0; r < kBlock; ++r) {
      for (int x = 0; x < kBlock; x += kLanes) store(hn::Div(sum.row[r][x / kLanes], every), out.at(x0 + x, y0 + r));
    }
  }
}

void shift(const PaddedPlane& from, const Vec2* d, int block_row, PaddedPlane& out) noexcept {
  const PaddedPlane* const plane = &from;
  const int y0 = block_row * kBlock;
  MovedPlanes moved(&plane, &d, 1, 0.0F, 0, y0);
  for (int c = 0; c < from.blocks_across(); ++c, moved.go_on()) {
    moved.move(0, [&](Vec v, int r, int x) HWY_ATTR { store(v, out.at(c * kBlock + x, y0 + r)); });
  }
}

constexpr float kBeyond = 1.0F;  // px beyond the border for which its repetition is good enough

void differ(const PaddedPlane* const* planes, const Vec2* const* d, int count, const PaddedPlane& from, int block_row,
            Columns columns, PaddedPlane& out, float* square) noexcept {
  const int y0 = block_row * kBlock;
  const Vec share = all(1.0F / static_cast<float>(count));
  MovedPlanes moved(planes, d, count, -kBeyond, columns.begin, y0);
  for (int c = columns.begin; c < columns.end; ++c, moved.go_on()) {
    const int x0 = c * kBlock;
    const bool whole = moved.all_see();
    BlockSum sum_of_moved;
    if (whole) add_moved(moved, sum_of_moved);
    Vec total = hn::Zero(Float());
    for (int r = 0; r < kBlock; ++r) {
      for (int x = 0; x < kBlock; x += kLanes) {
        const Vec mean = hn::Mul(share, sum_of_moved.row[r][x / kLanes]);
        const Vec off = whole ? hn::Sub(mean, load(from.at(x0 + x, y0 + r))) : hn::Zero(Float());
        store(off, out.at(x0 + x, y0 + r));
        total = hn::MulAdd(off, off, total);
      }
    }
    square[c] = whole ? sum(total) / (kBlock * kBlock) : kUnseen;
  }
}

// Offset to the next pixel along the axis more perpendicular to `e`.
HWY_INLINE std::ptrdiff_t step_across(Vec2 e, std::ptrdiff_t stride) {
  return std::abs(e.x) >= std::abs(e.y) ? stride : 1;
}

void fit(const PaddedPlane& now, const PaddedPlane& mean, const Vec2* direction, const float* lag, int block_row,
         FitSums* out) noexcept {
  const int y0 = block_row * kBlock;
  const std::ptrdiff_t stride = mean.stride();
  for (int c = 0; c < now.blocks_across(); ++c) {
    const int x0 = c * kBlock;
    const Vec2 e = direction[c];
    for (const PaddedPlane* plane : {&now, &mean}) prefetch_next(plane->at(x0, y0), plane->stride(), kBlock);
    const Source ahead = source_at(mean, x0, y0, e.x, e.y);
    const Source behind = source_at(mean, x0, y0, -e.x, -e.y);
    const Source away = source_at(mean, x0, y0, lag[c] * e.x, lag[c] * e.y);
    Vec error = hn::Zero(Float());
    Vec gradient = error;
    Vec structure = error;
    Vec across = error;
    Vec fine = error;
    const std::ptrdiff_t next = step_across(e, stride);
    for (int x = 0; x < kBlock; x += kLanes) {
      const float* first = mean.at(x0 + x, y0);
      Sampler before(first, stride, ahead);
      Sampler after(first, stride, behind);
      Sampler other(first, stride, away);
      for (int r = 0; r < kBlock; ++r) {
        const float* m = first + r * stride;
        const Vec here = load(m);
        const Vec off = hn::Sub(load(now.at(x0 + x, y0 + r)), here);
        const Vec g = hn::Sub(before.next(), after.next());
        const Vec s = hn::Sub(other.next(), here);
        const Vec b = hn::Sub(load(m + 2 * next), here);
        const Vec f = hn::Sub(load(m + next), here);
        error = hn::MulAdd(off, off, error);
        gradient = hn::MulAdd(g, g, gradient);
        structure = hn::MulAdd(s, s, structure);
        across = hn::MulAdd(b, b, across);
        fine = hn::MulAdd(f, f, fine);
      }
    }
    constexpr float kMean = 1.0F / (kBlock * kBlock);
    out[c] = {kMean * sum(error), 0.25F * kMean * sum(gradient), kMean * sum(structure), kMean * sum(across),
              kMean * sum(fine)};
  }
}

void mix(const FilterWeights* const* corners, const float* shares, std::size_t count, FilterWeights& out) noexcept {
  constexpr int kVectors = FilterWeights::kStride / kLanes;
  Vec w[kVectors];
  for (Vec& v : w) v = hn::Zero(Float());
  for (std::size_t k = 0; k < count; ++k) {
    for (int i = 0; i < kVectors; ++i) w[i] = hn::MulAdd(all(shares[k]), load(corners[k]->w + i * kLanes), w[i]);
  }
  for (int i = 0; i < kVectors; ++i) store(w[i], out.w + i * kLanes);
}

// Shares of the blocks before, here and after in the interpolation between block centres, by pixel.
struct Shares {
  HWY_ALIGN float before[kBlock];
  HWY_ALIGN float here[kBlock];
  HWY_ALIGN float after[kBlock];
  HWY_ALIGN float beside[kBlock];  // of the neighbour whose share is not 0

  Shares() {
    for (int i = 0; i < kBlock; ++i) {
      const float off = (static_cast<float>(i) - 0.5F * (kBlock - 1)) / kBlock;
      before[i] = std::max(-off, 0.0F);
      after[i] = std::max(off, 0.0F);
      beside[i] = before[i] + after[i];
      here[i] = 1.0F - beside[i];
    }
  }
};

// Weights of a block's pixels by tap and column: at its centre, and their change up to the block above or below.
struct PixelWeights {
  HWY_ALIGN float middle[FilterWeights::kError][kBlock];
  HWY_ALIGN float change[2][FilterWeights::kError][kBlock];
};

HWY_INLINE void spread_weights(const FilterWeights* const* rows, int block, int last, int taps, const Shares& shares,
                               PixelWeights& out) {
  const int before = std::max(block - 1, 0);
  const int after = std::min(block + 1, last);
  for (int x = 0; x < kBlock; x += kLanes) {
    const Vec of_before = hn::Load(Float(), shares.before + x);
    const Vec of_here = hn::Load(Float(), shares.here + x);
    const Vec of_after = hn::Load(Float(), shares.after + x);
    for (int i = 0; i < taps; ++i) {
      const auto of = [&](const FilterWeights* row) HWY_ATTR {
        const Vec sides = hn::MulAdd(of_after, all(row[after].w[i]), hn::Mul(of_before, all(row[before].w[i])));
        return hn::MulAdd(of_here, all(row[block].w[i]), sides);
      };
      const Vec middle = of(rows[1]);
      hn::Store(middle, Float(), out.middle[i] + x);
      hn::Store(hn::Sub(of(rows[0]), middle), Float(), out.change[0][i] + x);
      hn::Store(hn::Sub(of(rows[2]), middle), Float(), out.change[1][i] + x);
    }
  }
}

// Sums with the weights of the block's centre, and with their change.
struct HalfBlock {
  static constexpr int kRows = kBlock / 2;
  Vec middle[kRows];
  Vec change[kRows];

  HWY_INLINE HalfBlock() {
    for (int r = 0; r < kRows; ++r) middle[r] = change[r] = hn::Zero(Float());
  }
  HWY_INLINE void add(int r, Vec value, Vec in_middle, Vec by_row) {
    middle[r] = hn::MulAdd(in_middle, value, middle[r]);
    change[r] = hn::MulAdd(by_row, value, change[r]);
  }
};

// Filters four rows of kLanes columns from (x, y) on; `column`: of x in the block.
HWY_INLINE void filter_half(const FilterInputs& in, const Taps& taps, const PixelWeights& weights, const Shares& shares,
                            int x, int y, int column, PaddedPlane& out) {
  const int half = y % kBlock / HalfBlock::kRows;
  const std::ptrdiff_t stride = in.now->stride();
  HalfBlock sums;
  const auto along = [&](int j, const PaddedPlane& plane, int tap) HWY_ATTR __attribute__((always_inline)) {
    const Vec middle = hn::Load(Float(), weights.middle[tap] + column);
    const Vec change = hn::Load(Float(), weights.change[half][tap] + column);
    taps.values<HalfBlock::kRows>(j, plane.at(x, y), stride,
                                  [&](int r, Vec v) HWY_ATTR { sums.add(r, v, middle, change); });
  };
  for (int j = 0; j < kTaps; ++j) {
    along(j, *in.now, j);
    along(j, *in.mean, FilterWeights::kMean + j);
    if (in.ahead != nullptr) along(j, *in.ahead, FilterWeights::kAhead + j);
  }
  for (int i = 0; i < 2; ++i) {
    const int tap = FilterWeights::kBefore + i;
    const Vec middle = hn::Load(Float(), weights.middle[tap] + column);
    const Vec change = hn::Load(Float(), weights.change[half][tap] + column);
    for (int r = 0; r < HalfBlock::kRows; ++r) sums.add(r, load(in.before[i]->at(x, y + r)), middle, change);
  }
  for (int r = 0; r < HalfBlock::kRows; ++r) {
    const Vec share = all(shares.beside[y % kBlock + r]);
    store(hn::MulAdd(share, sums.change[r], sums.middle[r]), out.at(x, y + r));
  }
}

void filter(const FilterInputs& in, const Vec2* step, const FilterWeights* const* weights, int block_row,
            PaddedPlane& out) noexcept {
  const Shares shares;
  const int y0 = block_row * kBlock;
  const int last = in.now->blocks_across() - 1;
  PixelWeights of_pixels;
  for (int c = 0; c <= last; ++c) {
    for (const PaddedPlane* plane : {in.now, in.mean, in.ahead}) {
      if (plane != nullptr) prefetch_next(plane->at(c * kBlock, y0 + kReach), plane->stride(), kBlock);
    }
    for (const PaddedPlane* plane : in.before) prefetch_next(plane->at(c * kBlock, y0), plane->stride(), kBlock);
    const Taps taps(*in.now, c * kBlock, y0, step[c]);
    spread_weights(weights, c, last, in.ahead != nullptr ? FilterWeights::kError : FilterWeights::kAhead, shares,
                   of_pixels);
    for (int x = 0; x < kBlock; x += kLanes) {
      filter_half(in, taps, of_pixels, shares, c * kBlock + x, y0, x, out);
      filter_half(in, taps, of_pixels, shares, c * kBlock + x, y0 + HalfBlock::kRows, x, out);
    }
  }
}

void across(const PaddedPlane& from, const Vec2* direction, const AcrossWeights* weights, int block_row,
            PaddedPlane& out) noexcept {
  const int y0 = block_row * kBlock;
  for (int c = 0; c < from.blocks_across(); ++c) {
    const std::ptrdiff_t step = step_across(direction[c], from.stride());
    for (int r = 0; r < kBlock; ++r) {
      for (int x = c * kBlock; x < (c + 1) * kBlock; x += kLanes) {
        const float* p = from.at(x, y0 + r);
        const Vec here = load(p);
        Vec v = here;
        for (int i = 1; i <= AcrossWeights::kReach; ++i) {
          const Vec both = hn::Add(load(p + i * step), load(p - i * step));
          v = hn::MulAdd(all(weights[c].w[i - 1]), hn::NegMulAdd(all(2.0F), here, both), v);
        }
        store(v, out.at(x, y0 + r));
      }
    }
  }
}

}  // namespace bolo::motion::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();
#endif

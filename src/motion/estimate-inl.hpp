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

// ------------------------------------------------------------------ bicubic

// put(value, row, column) for every vector of the block at p - d.
template <typename Put>
HWY_INLINE void move_cubic(const PaddedPlane& a, int x0, int y0, Vec2 d, const Put& put) {
  const Whole s = whole_of(a, x0, y0, -d.x, -d.y);
  float wx[4];
  float wy[4];
  cubic(s.fx, wx);
  cubic(s.fy, wy);
  const float* from = a.at(x0 + s.x - 1, y0 + s.y - 1);
  prefetch_next(from, a.stride(), kBlock + 3);
  for (int x = 0; x < kBlock; x += kLanes) {
    const auto across = [&](int r) HWY_ATTR {
      const float* p = from + r * a.stride() + x;
      Vec v = hn::Mul(all(wx[0]), load(p));
      for (int i = 1; i < 4; ++i) v = hn::MulAdd(all(wx[i]), load(p + i), v);
      return v;
    };
    Vec rows[4] = {across(0), across(1), across(2)};
    HWY_UNROLL(8)
    for (int r = 0; r < kBlock; ++r) {
      rows[(r + 3) % 4] = across(r + 3);
      Vec v = hn::Mul(all(wy[0]), rows[r % 4]);
      for (int i = 1; i < 4; ++i) v = hn::MulAdd(all(wy[i]), rows[(r + i) % 4], v);
      put(v, r, x);
    }
  }
}

// A block in registers.
struct BlockSum {
  Vec row[kBlock][kBlock / kLanes];

  HWY_INLINE BlockSum() { std::fill_n(&row[0][0], sizeof(row) / sizeof(Vec), hn::Zero(Float())); }
};

// The sum of the planes moved by their displacements; all cover the whole block.
HWY_INLINE void add_moved(const PaddedPlane* const* planes, const Vec2* const* d, int count, int x0, int y0,
                          BlockSum& sum) {
  for (int i = 0; i < count; ++i) {
    move_cubic(*planes[i], x0, y0, d[i][x0 / kBlock],
               [&](Vec v, int r, int x) HWY_ATTR { sum.row[r][x / kLanes] = hn::Add(sum.row[r][x / kLanes], v); });
  }
}

// Their mean at a block that some do not cover; `otherwise` where none does.
HWY_NOINLINE void align_seen(const PaddedPlane* const* planes, const Vec2* const* d, int count,
                             const PaddedPlane& otherwise, int x0, int y0, PaddedPlane& out) {
  HWY_ALIGN float total[kBlock * kBlock] = {};
  HWY_ALIGN float seen[kBlock * kBlock] = {};
  for (int i = 0; i < count; ++i) {
    const Vec2 by = d[i][x0 / kBlock];
    const Inside inside(otherwise.geometry(), by, 0.0F);
    move_cubic(*planes[i], x0, y0, by, [&](Vec v, int r, int x) HWY_ATTR {
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

HWY_INLINE bool all_see(const Vec2* const* d, int count, Geometry g, float margin, int x0, int y0) {
  bool whole = true;
  for (int i = 0; i < count; ++i) whole = whole && Inside(g, d[i][x0 / kBlock], margin).whole(x0, y0);
  return whole;
}

void align(const PaddedPlane* const* planes, const Vec2* const* d, int count, const PaddedPlane& now, int block_row,
           PaddedPlane& out) noexcept {
  const int y0 = block_row * kBlock;
  const Vec every = all(static_cast<float>(count));
  for (int x0 = 0; x0 < now.blocks_across() * kBlock; x0 += kBlock) {
    if (!all_see(d, count, now.geometry(), 0.0F, x0, y0)) {
      align_seen(planes, d, count, now, x0, y0, out);
      continue;
    }
    BlockSum sum;
    add_moved(planes, d, count, x0, y0, sum);
    for (int r = 0; r < kBlock; ++r) {
      for (int x = 0; x < kBlock; x += kLanes) store(hn::Div(sum.row[r][x / kLanes], every), out.at(x0 + x, y0 + r));
    }
  }
}

void shift(const PaddedPlane& from, const Vec2* d, int block_row, PaddedPlane& out) noexcept {
  for (int c = 0; c < from.blocks_across(); ++c) {
    const int x0 = c * kBlock;
    const int y0 = block_row * kBlock;
    move_cubic(from, x0, y0, d[c], [&](Vec v, int r, int x) HWY_ATTR { store(v, out.at(x0 + x, y0 + r)); });
  }
}

constexpr float kBeyond = 1.0F;  // px, where a repeated border is good enough

void differ(const PaddedPlane* const* planes, const Vec2* const* d, int count, const PaddedPlane& from, int block_row,
            Columns columns, PaddedPlane& out, float* square) noexcept {
  const int y0 = block_row * kBlock;
  const Vec share = all(1.0F / static_cast<float>(count));
  for (int c = columns.begin; c < columns.end; ++c) {
    const int x0 = c * kBlock;
    const bool whole = all_see(d, count, from.geometry(), -kBeyond, x0, y0);
    BlockSum moved;
    if (whole) add_moved(planes, d, count, x0, y0, moved);
    Vec total = hn::Zero(Float());
    for (int r = 0; r < kBlock; ++r) {
      for (int x = 0; x < kBlock; x += kLanes) {
        const Vec mean = hn::Mul(share, moved.row[r][x / kLanes]);
        const Vec off = whole ? hn::Sub(mean, load(from.at(x0 + x, y0 + r))) : hn::Zero(Float());
        store(off, out.at(x0 + x, y0 + r));
        total = hn::MulAdd(off, off, total);
      }
    }
    square[c] = whole ? sum(total) / (kBlock * kBlock) : kUnseen;
  }
}

// ------------------------------------------------------------------ along the motion

// To the next pixel along the axis that is more across `e`.
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

// For the pixels of half a block, the shares of the blocks before and after in interpolation between centres.
struct Shares {
  HWY_ALIGN float before[kBlock];
  HWY_ALIGN float here[kBlock];
  HWY_ALIGN float after[kBlock];
  HWY_ALIGN float beside[kBlock];  // of the one of the two that counts

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

// The weights of a block's pixels, by tap and column: at its centre, and their change up to the centre of the block
// above or below.
struct PixelWeights {
  HWY_ALIGN float middle[FilterWeights::kError][kBlock];
  HWY_ALIGN float change[2][FilterWeights::kError][kBlock];
};

HWY_INLINE void spread_weights(const FilterWeights* const* rows, int block, int last, int taps, const Shares& shares,
                               PixelWeights& out) {
  const int before = std::max(block - 1, 0);
  const int after = std::min(block + 1, last);
  for (int x = 0; x < kBlock; x += kLanes) {
    const auto left = hn::Lt(count_from(static_cast<float>(x)), all(0.5F * kBlock));
    const Vec share = hn::Load(Float(), shares.beside + x);
    for (int i = 0; i < taps; ++i) {
      const auto of = [&](const FilterWeights* row) HWY_ATTR {
        return between(all(row[block].w[i]), hn::IfThenElse(left, all(row[before].w[i]), all(row[after].w[i])), share);
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

// Four rows of kLanes columns from (x, y) on, which are the block's `column` and after.
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

// ------------------------------------------------------------------ across the motion

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

#include "src/motion/kernels.hpp"

#include <algorithm>
#include <cmath>
#include <vector>

#include "src/core/simd_targets.hpp"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "src/motion/kernels.cpp"
#include <hwy/foreach_target.h>
#include <hwy/highway.h>

#include <hwy/contrib/math/math-inl.h>
#include <hwy/targets.h>

HWY_BEFORE_NAMESPACE();
namespace bolo::motion::HWY_NAMESPACE {

namespace hn = hwy::HWY_NAMESPACE;
using Float = hn::CappedTag<float, kBlock>;
constexpr std::ptrdiff_t kRow = kBlock;  // from one row of a block's pixels to the next
using Vec = hn::Vec<Float>;

inline constexpr int kLanes = static_cast<int>(hn::MaxLanes(Float()));

HWY_INLINE Vec all(float value) { return hn::Set(Float(), value); }
HWY_INLINE Vec load(const float* from) { return hn::LoadU(Float(), from); }
HWY_INLINE void store(Vec x, float* to) { hn::StoreU(x, Float(), to); }
HWY_INLINE float sum(Vec x) { return hn::GetLane(hn::SumOfLanes(Float(), x)); }
HWY_INLINE Vec count_from(float first) { return hn::Iota(Float(), first); }

// ------------------------------------------------------------------ rows

void innovate(const PaddedPlane& now, const PaddedPlane& before, float gain, int begin, int end,
              PaddedPlane& out) noexcept {
  const int width = now.blocks_across() * kBlock;
  for (int y = begin; y < end; ++y) {
    const float* a = now.at(0, y);
    const float* b = before.at(0, y);
    float* o = out.at(0, y);
    for (int x = 0; x < width; x += kLanes) {
      const Vec old = load(b + x);
      store(hn::MulAdd(all(gain), hn::Sub(load(a + x), old), old), o + x);
    }
  }
}

// exp(-i^2 / 2), i = 0 .. 4, normalised over -4 .. 4.
constexpr float kGauss[] = {0.39895F, 0.24197F, 0.05400F, 0.00443F, 0.000125F};

void smooth(const PaddedPlane& from, int begin, int end, PaddedPlane& out) noexcept {
  const int width = from.blocks_across() * kBlock;
  const std::ptrdiff_t stride = from.stride();
  HWY_ALIGN float down[kBlock + 2 * kRim + 4096];  // one row, summed from above to below
  for (int y = begin; y < end; ++y) {
    for (int left = 0; left < width; left += 4096) {
      const int count = std::min(4096, width - left);
      const float* centre = from.at(left, y);
      for (int x = -kBlock; x < count + kBlock; x += kLanes) {
        const float* c = centre + x;
        Vec s = hn::Mul(all(kGauss[0]), load(c));
        for (int i = 1; i <= 4; ++i) {
          s = hn::MulAdd(all(kGauss[i]), hn::Add(load(c - i * stride), load(c + i * stride)), s);
        }
        store(s, down + kBlock + x);
      }
      float* o = out.at(left, y);
      for (int x = 0; x < count; x += kLanes) {
        const float* c = down + kBlock + x;
        Vec s = hn::Mul(all(kGauss[0]), load(c));
        for (int i = 1; i <= 4; ++i) s = hn::MulAdd(all(kGauss[i]), hn::Add(load(c - i), load(c + i)), s);
        store(s, o + x);
      }
    }
  }
}

void halve(const PaddedPlane& from, int begin, int end, PaddedPlane& out) noexcept {
  const int width = out.geometry().width;
  for (int y = begin; y < end; ++y) {
    const float* a = from.at(0, 2 * y);
    const float* b = from.at(0, 2 * y + 1);
    float* o = out.at(0, y);
    for (std::ptrdiff_t x = 0; x < width; ++x) o[x] = 0.25F * (a[2 * x] + a[2 * x + 1] + b[2 * x] + b[2 * x + 1]);
  }
}

float mean_difference(const PaddedPlane& a, const PaddedPlane& b, int dx, int dy) noexcept {
  const Geometry g = a.geometry();
  const int left = std::max(dx, 0);
  const int right = std::min(g.width + dx, g.width);
  const int top = std::max(dy, 0);
  const int bottom = std::min(g.height + dy, g.height);
  const int width = right - left;
  if (width < 1 || bottom <= top || 4 * width * (bottom - top) < g.width * g.height) return 1e30F;
  Vec total = hn::Zero(Float());
  float rest = 0.0F;
  for (int y = top; y < bottom; ++y) {
    const float* p = b.at(left, y);
    const float* q = a.at(left - dx, y - dy);
    int x = 0;
    for (; x + kLanes <= width; x += kLanes) total = hn::Add(total, hn::Abs(hn::Sub(load(p + x), load(q + x))));
    for (; x < width; ++x) rest += std::abs(p[x] - q[x]);
  }
  return (sum(total) + rest) / static_cast<float>(width * (bottom - top));
}

// ------------------------------------------------------------------ moved blocks

// Where a block's source lies: its whole part as an offset from the block, bilinear weights for the rest.
struct Source {
  std::ptrdiff_t offset;
  float w00;
  float w10;
  float w01;
  float w11;
};

// So far that a block of 12 x 12 around (x0, y0) would leave the rim, it sees nothing but the repeated border: it may
// as well stay at the rim.
HWY_INLINE int limited(float whole, int first, int blocks) {
  const float low = static_cast<float>(2 - kRim - first);
  const float high = static_cast<float>(blocks * kBlock + kRim - kBlock - 4 - first);
  return static_cast<int>(std::min(std::max(whole, low), high));
}

struct Whole {
  int x;
  int y;
  float fx;
  float fy;
};

HWY_INLINE Whole whole_of(const PaddedPlane& plane, int x0, int y0, float sx, float sy) {
  const float ix = std::floor(sx);
  const float iy = std::floor(sy);
  return {limited(ix, x0, plane.blocks_across()), limited(iy, y0, plane.blocks_down()), sx - ix, sy - iy};
}

// Of p + s for the pixels p of the block at (x0, y0).
HWY_INLINE Source source_at(const PaddedPlane& plane, int x0, int y0, float sx, float sy) {
  const Whole s = whole_of(plane, x0, y0, sx, sy);
  return {s.y * plane.stride() + s.x, (1 - s.fx) * (1 - s.fy), s.fx * (1 - s.fy), (1 - s.fx) * s.fy, s.fx * s.fy};
}

HWY_INLINE Vec sample(const float* at, std::ptrdiff_t stride, const Source& s) {
  Vec v = hn::Mul(all(s.w00), load(at));
  v = hn::MulAdd(all(s.w10), load(at + 1), v);
  v = hn::MulAdd(all(s.w01), load(at + stride), v);
  return hn::MulAdd(all(s.w11), load(at + stride + 1), v);
}

// 1 for pixels x0 .. of row y whose source p - d keeps `margin` from the border.
struct Inside {
  float low_x;
  float high_x;
  float low_y;
  float high_y;

  Inside(Geometry g, Vec2 d, float margin)
      : low_x(std::max(d.x + margin, 0.0F)),
        high_x(std::min(d.x - margin, 0.0F) + static_cast<float>(g.width - 1)),
        low_y(std::max(d.y + margin, 0.0F)),
        high_y(std::min(d.y - margin, 0.0F) + static_cast<float>(g.height - 1)) {}
  bool whole(int x0, int y0) const {
    return static_cast<float>(x0) >= low_x && static_cast<float>(x0 + kBlock - 1) <= high_x &&
           static_cast<float>(y0) >= low_y && static_cast<float>(y0 + kBlock - 1) <= high_y;
  }
  bool row(int y) const { return static_cast<float>(y) >= low_y && static_cast<float>(y) <= high_y; }
  HWY_INLINE Vec mask(int x) const {
    const Vec at = count_from(static_cast<float>(x));
    const auto in = hn::And(hn::Ge(at, all(low_x)), hn::Le(at, all(high_x)));
    return hn::IfThenElseZero(in, all(1.0F));
  }
};

constexpr std::ptrdiff_t kMovedStride = 24;  // 10 columns, written in whole vectors

// The block and one pixel around it, moved.
HWY_INLINE void move_block(const PaddedPlane& a, int x0, int y0, Vec2 d, float* out) {
  const Source s = source_at(a, x0, y0, -d.x, -d.y);
  const float* from = a.at(x0 - 1, y0 - 1) + s.offset;
  for (int r = 0; r < kBlock + 2; ++r) {
    const float* row = from + r * a.stride();
    for (int x = 0; x < kBlock; x += kLanes) store(sample(row + x, a.stride(), s), out + r * kMovedStride + x);
    for (int x = kBlock; x < kBlock + 2; ++x) {
      out[r * kMovedStride + x] =
          s.w00 * row[x] + s.w10 * row[x + 1] + s.w01 * row[x + a.stride()] + s.w11 * row[x + a.stride() + 1];
    }
  }
}

HWY_INLINE MatchSums match_block(const PaddedPlane& a, const PaddedPlane& b, int x0, int y0, Vec2 d, float margin) {
  HWY_ALIGN float moved[(kBlock + 2) * kMovedStride];
  move_block(a, x0, y0, d, moved);
  const Inside inside(a.geometry(), d, margin);
  const bool whole = inside.whole(x0, y0);
  Vec xx = hn::Zero(Float());
  Vec xy = xx;
  Vec yy = xx;
  Vec xe = xx;
  Vec ye = xx;
  Vec ee = xx;
  Vec count = xx;
  for (int r = 0; r < kBlock; ++r) {
    if (!whole && !inside.row(y0 + r)) continue;
    for (int x = 0; x < kBlock; x += kLanes) {
      const float* up = moved + r * kMovedStride + x;
      const float* mid = up + kMovedStride;
      const float* low = mid + kMovedStride;
      const Vec up_left = load(up);
      const Vec up_right = load(up + 2);
      const Vec low_left = load(low);
      const Vec low_right = load(low + 2);
      const Vec two = all(2.0F);
      Vec gx = hn::Add(hn::Sub(up_right, up_left), hn::Sub(low_right, low_left));
      gx = hn::MulAdd(two, hn::Sub(load(mid + 2), load(mid)), gx);
      Vec gy = hn::Add(hn::Sub(low_left, up_left), hn::Sub(low_right, up_right));
      gy = hn::MulAdd(two, hn::Sub(load(low + 1), load(up + 1)), gy);
      Vec e = hn::Sub(load(b.at(x0 + x, y0 + r)), load(mid + 1));
      if (!whole) {
        const Vec in = inside.mask(x0 + x);
        gx = hn::Mul(gx, in);
        gy = hn::Mul(gy, in);
        e = hn::Mul(e, in);
        count = hn::Add(count, in);
      }
      xx = hn::MulAdd(gx, gx, xx);
      xy = hn::MulAdd(gx, gy, xy);
      yy = hn::MulAdd(gy, gy, yy);
      xe = hn::MulAdd(gx, e, xe);
      ye = hn::MulAdd(gy, e, ye);
      ee = hn::MulAdd(e, e, ee);
    }
  }
  constexpr float kSobel = 1.0F / 8.0F;
  return {kSobel * kSobel * sum(xx),
          kSobel * kSobel * sum(xy),
          kSobel * kSobel * sum(yy),
          kSobel * sum(xe),
          kSobel * sum(ye),
          sum(ee),
          whole ? kBlock * kBlock : sum(count)};
}

void match(const PaddedPlane& a, const PaddedPlane& b, const Vec2* d, int block_row, float margin,
           MatchSums* out) noexcept {
  const int y0 = block_row * kBlock;
  for (int c = 0; c < a.blocks_across(); ++c) out[c] = match_block(a, b, c * kBlock, y0, d[c], margin);
}

void cost(const PaddedPlane& a, const PaddedPlane& b, const Vec2* d, int block_row, float cap, float* out) noexcept {
  const int y0 = block_row * kBlock;
  for (int c = 0; c < a.blocks_across(); ++c) {
    const int x0 = c * kBlock;
    const Source s = source_at(a, x0, y0, -d[c].x, -d[c].y);
    Vec total = hn::Zero(Float());
    for (int r = 0; r < kBlock; ++r) {
      for (int x = 0; x < kBlock; x += kLanes) {
        const Vec moved = sample(a.at(x0 + x, y0 + r) + s.offset, a.stride(), s);
        const Vec e = hn::Sub(load(b.at(x0 + x, y0 + r)), moved);
        total = hn::Add(total, hn::Min(hn::Mul(e, e), all(cap)));
      }
    }
    out[c] = sum(total) / (kBlock * kBlock);
  }
}

constexpr int kSearchAcross = 9;
constexpr int kSearchDown = 5;
constexpr int kSide = 12;  // of the half-size window
constexpr std::ptrdiff_t kPatchStride = 40;
constexpr int kPatchRows = kSide + 2 * kSearchDown;
constexpr int kPatchColumns = kSide + 2 * kSearchAcross;

// Values of a plane at p - d for a patch from (x0, y0) on; beyond the frame its border.
HWY_INLINE void move_patch(const PaddedPlane& a, int x0, int y0, Vec2 d, float* out) {
  const float ix = std::floor(-d.x);
  const float iy = std::floor(-d.y);
  const float fx = -d.x - ix;
  const float fy = -d.y - iy;
  const int left = x0 + static_cast<int>(std::clamp(ix, -1e6F, 1e6F));
  const int top = y0 + static_cast<int>(std::clamp(iy, -1e6F, 1e6F));
  const Geometry g = a.geometry();
  for (int r = 0; r < kPatchRows; ++r) {
    const float* upper = a.at(0, std::clamp(top + r, 0, g.height - 1));
    const float* lower = a.at(0, std::clamp(top + r + 1, 0, g.height - 1));
    const auto down = [&](int x) { return upper[x] + fy * (lower[x] - upper[x]); };
    float here = down(std::clamp(left, 0, g.width - 1));
    for (int c = 0; c < kPatchColumns; ++c) {
      const float next = down(std::clamp(left + c + 1, 0, g.width - 1));
      out[r * kPatchStride + c] = here + fx * (next - here);
      here = next;
    }
  }
}

Vec2 search(const PaddedPlane& a, const PaddedPlane& b, int column, int row, Vec2 d, float price) noexcept {
  const int x0 = column * (kBlock / 2) - (kSide - kBlock / 2) / 2;
  const int y0 = row * (kBlock / 2) - (kSide - kBlock / 2) / 2;
  HWY_ALIGN float from[kPatchRows * kPatchStride] = {};
  HWY_ALIGN float to[kSide * 2 * kBlock] = {};
  move_patch(a, x0 - kSearchAcross, y0 - kSearchDown, d, from);
  const Geometry g = b.geometry();
  for (int r = 0; r < kSide; ++r) {
    const float* line = b.at(0, std::clamp(y0 + r, 0, g.height - 1));
    for (int c = 0; c < kSide; ++c) to[r * 2 * kBlock + c] = line[std::clamp(x0 + c, 0, g.width - 1)];
  }
  float best = 1e30F;
  Vec2 found;
  for (int sy = -kSearchDown; sy <= kSearchDown; ++sy) {
    for (int sx = -kSearchAcross; sx <= kSearchAcross; ++sx) {
      Vec total = hn::Zero(Float());
      for (int r = 0; r < kSide; ++r) {
        const float* p = from + (r + kSearchDown - sy) * kPatchStride + kSearchAcross - sx;
        const float* q = to + r * (2 * kRow);
        for (int x = 0; x < kBlock; x += kLanes) {
          const Vec e = hn::Sub(load(q + x), load(p + x));
          total = hn::MulAdd(e, e, total);
        }
        if constexpr (kLanes == kBlock) {
          const Vec tail =
              hn::IfThenElseZero(hn::Lt(count_from(0.0F), all(static_cast<float>(kSide - kBlock))), all(1.0F));
          const Vec e = hn::Mul(hn::Sub(load(q + kBlock), load(p + kBlock)), tail);
          total = hn::MulAdd(e, e, total);
        } else {
          for (int x = kBlock; x < kSide; x += kLanes) {
            const Vec e = hn::Sub(load(q + x), load(p + x));
            total = hn::MulAdd(e, e, total);
          }
        }
      }
      const float error = sum(total) / (kSide * kSide) + price * static_cast<float>(sx * sx + sy * sy);
      if (error >= best) continue;
      best = error;
      found = {static_cast<float>(sx), static_cast<float>(sy)};
    }
  }
  return found;
}

void energy(const PaddedPlane& b, int block_row, float* mean, float* square) noexcept {
  for (int c = 0; c < b.blocks_across(); ++c) {
    Vec first = hn::Zero(Float());
    Vec second = first;
    const Vec base = all(*b.at(c * kBlock, block_row * kBlock));
    for (int r = 0; r < kBlock; ++r) {
      for (int x = 0; x < kBlock; x += kLanes) {
        const Vec v = hn::Sub(load(b.at(c * kBlock + x, block_row * kBlock + r)), base);
        first = hn::Add(first, v);
        second = hn::MulAdd(v, v, second);
      }
    }
    const float m = sum(first) / (kBlock * kBlock);
    mean[c] = m + hn::GetLane(base);
    square[c] = std::max(sum(second) / (kBlock * kBlock) - m * m, 0.0F);  // about the block's own mean
  }
}

// ------------------------------------------------------------------ bicubic

// Keys' kernel with a = -0.75 at -1, 0, 1, 2 for a point f after 0.
HWY_INLINE void cubic(float f, float* w) {
  constexpr float a = -0.75F;
  const auto far = [&](float t) { return ((a * t - 5 * a) * t + 8 * a) * t - 4 * a; };
  const auto near = [&](float t) { return ((a + 2) * t - (a + 3)) * t * t + 1; };
  w[0] = far(f + 1);
  w[1] = near(f);
  w[2] = near(1 - f);
  w[3] = 1.0F - w[0] - w[1] - w[2];
}

HWY_INLINE void move_cubic(const PaddedPlane& a, int x0, int y0, Vec2 d, float* out) {
  const Whole s = whole_of(a, x0, y0, -d.x, -d.y);
  float wx[4];
  float wy[4];
  cubic(s.fx, wx);
  cubic(s.fy, wy);
  const float* from = a.at(x0 + s.x - 1, y0 + s.y - 1);
  HWY_ALIGN float across[(kBlock + 3) * kBlock];
  for (int r = 0; r < kBlock + 3; ++r) {
    for (int x = 0; x < kBlock; x += kLanes) {
      const float* p = from + r * a.stride() + x;
      Vec v = hn::Mul(all(wx[0]), load(p));
      for (int i = 1; i < 4; ++i) v = hn::MulAdd(all(wx[i]), load(p + i), v);
      store(v, across + r * kRow + x);
    }
  }
  for (int r = 0; r < kBlock; ++r) {
    for (int x = 0; x < kBlock; x += kLanes) {
      const float* p = across + r * kRow + x;
      Vec v = hn::Mul(all(wy[0]), load(p));
      for (int i = 1; i < 4; ++i) v = hn::MulAdd(all(wy[i]), load(p + i * kRow), v);
      store(v, out + r * kRow + x);
    }
  }
}

HWY_INLINE void add_inside(const float* block, const Inside& inside, int x0, int y0, float* total, float* count) {
  for (int r = 0; r < kBlock; ++r) {
    if (!inside.row(y0 + r)) continue;
    for (int x = 0; x < kBlock; x += kLanes) {
      const int at = r * kBlock + x;
      const Vec in = inside.mask(x0 + x);
      store(hn::MulAdd(in, load(block + at), load(total + at)), total + at);
      store(hn::Add(in, load(count + at)), count + at);
    }
  }
}

void align(const PaddedPlane* const* planes, const Vec2* const* d, int planes_count, const PaddedPlane& now,
           int block_row, PaddedPlane& out) noexcept {
  const int y0 = block_row * kBlock;
  for (int c = 0; c < now.blocks_across(); ++c) {
    const int x0 = c * kBlock;
    HWY_ALIGN float total[kBlock * kBlock] = {};
    HWY_ALIGN float count[kBlock * kBlock] = {};
    HWY_ALIGN float moved[kBlock * kBlock];
    for (int i = 0; i < planes_count; ++i) {
      move_cubic(*planes[i], x0, y0, d[i][c], moved);
      add_inside(moved, Inside(now.geometry(), d[i][c], 0.0F), x0, y0, total, count);
    }
    for (int r = 0; r < kBlock; ++r) {
      for (int x = 0; x < kBlock; x += kLanes) {
        const Vec n = load(count + r * kRow + x);
        const Vec mean = hn::Div(load(total + r * kRow + x), hn::Max(n, all(1.0F)));
        const Vec old = load(now.at(x0 + x, y0 + r));
        store(hn::IfThenElse(hn::Gt(n, hn::Zero(Float())), mean, old), out.at(x0 + x, y0 + r));
      }
    }
  }
}

void shift(const PaddedPlane& from, const Vec2* d, int block_row, PaddedPlane& out) noexcept {
  HWY_ALIGN float moved[kBlock * kBlock];
  for (int c = 0; c < from.blocks_across(); ++c) {
    move_cubic(from, c * kBlock, block_row * kBlock, d[c], moved);
    for (int r = 0; r < kBlock; ++r) std::copy_n(moved + r * kRow, kBlock, out.at(c * kBlock, block_row * kBlock + r));
  }
}

// ------------------------------------------------------------------ along the motion

void fit(const PaddedPlane& now, const PaddedPlane& mean, const Vec2* direction, const float* lag, int block_row,
         FitSums* out) noexcept {
  const int y0 = block_row * kBlock;
  const std::ptrdiff_t stride = mean.stride();
  for (int c = 0; c < now.blocks_across(); ++c) {
    const int x0 = c * kBlock;
    const Vec2 e = direction[c];
    const Source ahead = source_at(mean, x0, y0, e.x, e.y);
    const Source behind = source_at(mean, x0, y0, -e.x, -e.y);
    const Source away = source_at(mean, x0, y0, lag[c] * e.x, lag[c] * e.y);
    Vec error = hn::Zero(Float());
    Vec gradient = error;
    Vec structure = error;
    for (int r = 0; r < kBlock; ++r) {
      for (int x = 0; x < kBlock; x += kLanes) {
        const float* m = mean.at(x0 + x, y0 + r);
        const Vec here = load(m);
        const Vec off = hn::Sub(load(now.at(x0 + x, y0 + r)), here);
        const Vec g = hn::Sub(sample(m + ahead.offset, stride, ahead), sample(m + behind.offset, stride, behind));
        const Vec s = hn::Sub(sample(m + away.offset, stride, away), here);
        error = hn::MulAdd(off, off, error);
        gradient = hn::MulAdd(g, g, gradient);
        structure = hn::MulAdd(s, s, structure);
      }
    }
    constexpr float kMean = 1.0F / (kBlock * kBlock);
    out[c] = {kMean * sum(error), 0.25F * kMean * sum(gradient), kMean * sum(structure)};
  }
}

// Of the pixels of half a block, the shares of the blocks before and after in what is interpolated between centres.
struct Shares {
  HWY_ALIGN float before[kBlock];
  HWY_ALIGN float here[kBlock];
  HWY_ALIGN float after[kBlock];

  Shares() {
    for (int i = 0; i < kBlock; ++i) {
      const float off = (static_cast<float>(i) - 0.5F * (kBlock - 1)) / kBlock;
      before[i] = std::max(-off, 0.0F);
      after[i] = std::max(off, 0.0F);
      here[i] = 1.0F - before[i] - after[i];
    }
  }
};

// The weights of one row of pixels at the centres of its blocks.
HWY_INLINE void mix_rows(const FilterWeights* const* weights, const Shares& shares, int r, int blocks, float* out) {
  const FilterWeights* near = shares.before[r] > 0.0F ? weights[0] : weights[2];
  const Vec share = all(shares.before[r] + shares.after[r]);
  for (int c = 0; c < blocks; ++c) {
    for (int i = 0; i < FilterWeights::kStride; i += kLanes) {
      const Vec here = load(weights[1][c].w + i);
      store(hn::MulAdd(share, hn::Sub(load(near[c].w + i), here), here), out + c * FilterWeights::kStride + i);
    }
  }
}

// Sums for the blocks before, at and after.
struct Three {
  Vec before;
  Vec here;
  Vec after;

  HWY_INLINE void add(Vec value, const float* left, const float* mid, const float* right) {
    before = hn::MulAdd(all(*left), value, before);
    here = hn::MulAdd(all(*mid), value, here);
    after = hn::MulAdd(all(*right), value, after);
  }
};

constexpr int kMostBlocks = 64;  // across, that are filtered at once

void filter_blocks(const FilterInputs& in, const Vec2* direction, const FilterWeights* const* weights, int block_row,
                   int first, int end, PaddedPlane& out) {
  const Shares shares;
  const int y0 = block_row * kBlock;
  const int last = in.now->blocks_across() - 1;
  const int from = std::max(first - 1, 0);
  const int to = std::min(end, last) + 1;
  const FilterWeights* rows[3] = {weights[0] + from, weights[1] + from, weights[2] + from};
  HWY_ALIGN float mixed[(kMostBlocks + 2) * FilterWeights::kStride];
  Source tap[kMostBlocks][kTaps];
  for (int c = first; c < end; ++c) {
    for (int j = 0; j < kTaps; ++j) {
      const auto q = static_cast<float>(j - kReach);
      tap[c - first][j] = source_at(*in.now, c * kBlock, y0, q * direction[c].x, q * direction[c].y);
    }
  }
  const std::ptrdiff_t stride = in.now->stride();
  for (int r = 0; r < kBlock; ++r) {
    mix_rows(rows, shares, r, to - from, mixed);
    for (int c = first; c < end; ++c) {
      const float* mid = mixed + (c - from) * FilterWeights::kStride;
      const float* left = c > 0 ? mid - FilterWeights::kStride : mid;
      const float* right = c < last ? mid + FilterWeights::kStride : mid;
      for (int x = 0; x < kBlock; x += kLanes) {
        const int column = c * kBlock + x;
        Three s{hn::Zero(Float()), hn::Zero(Float()), hn::Zero(Float())};
        const auto along = [&](const PaddedPlane& plane, int w) HWY_ATTR {
          const float* p = plane.at(column, y0 + r);
          for (int j = 0; j < kTaps; ++j) {
            const Source& at = tap[c - first][j];
            s.add(sample(p + at.offset, stride, at), left + w + j, mid + w + j, right + w + j);
          }
        };
        along(*in.now, 0);
        along(*in.mean, FilterWeights::kMean);
        if (in.ahead != nullptr) along(*in.ahead, FilterWeights::kAhead);
        for (int i = 0; i < 2; ++i) {
          const int w = FilterWeights::kBefore + i;
          s.add(load(in.before[i]->at(column, y0 + r)), left + w, mid + w, right + w);
        }
        Vec v = hn::Mul(hn::Load(Float(), shares.before + x), s.before);
        v = hn::MulAdd(hn::Load(Float(), shares.here + x), s.here, v);
        store(hn::MulAdd(hn::Load(Float(), shares.after + x), s.after, v), out.at(column, y0 + r));
      }
    }
  }
}

void filter(const FilterInputs& in, const Vec2* direction, const FilterWeights* const* weights, int block_row,
            PaddedPlane& out) noexcept {
  const int blocks = in.now->blocks_across();
  for (int first = 0; first < blocks; first += kMostBlocks) {
    filter_blocks(in, direction, weights, block_row, first, std::min(first + kMostBlocks, blocks), out);
  }
}

// ------------------------------------------------------------------ physics

constexpr int kFewestSteps = 3;
constexpr int kMostSteps = 30;

// Shares of the trail's steps, the newest first.
HWY_INLINE int trail(Vec2 d, float ratio, float* share) {
  const float length = std::sqrt(d.x * d.x + d.y * d.y);
  const int steps = std::clamp(static_cast<int>(std::ceil(length)), kFewestSteps, kMostSteps);
  float total = 0.0F;
  for (int i = 0; i < steps; ++i) {
    share[i] = std::exp(-ratio * (static_cast<float>(i) + 0.5F) / static_cast<float>(steps));
    total += share[i];
  }
  for (int i = 0; i < steps; ++i) share[i] /= total;
  return steps;
}

void check(const PaddedPlane& x, const PaddedPlane& z, const PaddedPlane& y, const Vec2* d, float ratio, int block_row,
           PaddedPlane& left, float* left_square, float* change_square) noexcept {
  const int y0 = block_row * kBlock;
  float share[kMostSteps];
  for (int c = 0; c < x.blocks_across(); ++c) {
    const int x0 = c * kBlock;
    const int steps = trail(d[c], ratio, share);
    HWY_ALIGN float blurred[kBlock * kBlock] = {};
    for (int i = 0; i < steps; ++i) {
      const float f = (static_cast<float>(i) + 0.5F) / static_cast<float>(steps);
      Source s = source_at(x, x0, y0, f * d[c].x, f * d[c].y);
      s.w00 *= share[i];
      s.w10 *= share[i];
      s.w01 *= share[i];
      s.w11 *= share[i];
      const float* from = x.at(x0, y0) + s.offset;
      for (int r = 0; r < kBlock; ++r) {
        for (int k = 0; k < kBlock; k += kLanes) {
          float* to = blurred + r * kRow + k;
          store(hn::Add(load(to), sample(from + r * x.stride() + k, x.stride(), s)), to);
        }
      }
    }
    Vec residual = hn::Zero(Float());
    Vec change = residual;
    for (int r = 0; r < kBlock; ++r) {
      for (int k = 0; k < kBlock; k += kLanes) {
        const Vec innovation = load(z.at(x0 + k, y0 + r));
        const Vec e = hn::Sub(innovation, load(blurred + r * kRow + k));
        const Vec m = hn::Sub(innovation, load(y.at(x0 + k, y0 + r)));
        store(e, left.at(x0 + k, y0 + r));
        residual = hn::MulAdd(e, e, residual);
        change = hn::MulAdd(m, m, change);
      }
    }
    left_square[c] = sum(residual) / (kBlock * kBlock);
    change_square[c] = sum(change) / (kBlock * kBlock);
  }
}

// The value of a block field at eight pixels of a row, interpolated between centres.
HWY_INLINE Vec between(const Shares& shares, const float* const* rows, int r, int c, int last, int x) {
  const float* near = shares.before[r] > 0.0F ? rows[0] : rows[2];
  const float share = shares.before[r] + shares.after[r];
  const auto at = [&](int column) { return rows[1][column] + share * (near[column] - rows[1][column]); };
  Vec v = hn::Mul(hn::Load(Float(), shares.before + x), all(at(std::max(c - 1, 0))));
  v = hn::MulAdd(hn::Load(Float(), shares.here + x), all(at(c)), v);
  return hn::MulAdd(hn::Load(Float(), shares.after + x), all(at(std::min(c + 1, last))), v);
}

void correct(const PaddedPlane& left, const float* const* w, int block_row, PaddedPlane& x) noexcept {
  const Shares shares;
  const int last = x.blocks_across() - 1;
  for (int r = 0; r < kBlock; ++r) {
    for (int c = 0; c <= last; ++c) {
      for (int k = 0; k < kBlock; k += kLanes) {
        float* to = x.at(c * kBlock + k, block_row * kBlock + r);
        const Vec e = load(left.at(c * kBlock + k, block_row * kBlock + r));
        store(hn::MulAdd(between(shares, w, r, c, last, k), e, load(to)), to);
      }
    }
  }
}

void blend(const PaddedPlane& x, const float* other, const float* const* c, int block_row, float* out) noexcept {
  const Shares shares;
  const Geometry g = x.geometry();
  const int last = x.blocks_across() - 1;
  const int rows = std::min(kBlock, g.height - block_row * kBlock);
  for (int r = 0; r < rows; ++r) {
    const int y = block_row * kBlock + r;
    const std::size_t row = static_cast<std::size_t>(y) * static_cast<std::size_t>(g.width);
    for (int b = 0; b <= last; ++b) {
      for (int k = 0; k < kBlock; k += kLanes) {
        const int column = b * kBlock + k;
        const int count = std::min(kLanes, g.width - column);
        if (count <= 0) break;
        HWY_ALIGN float part[kLanes];
        for (int i = 0; i < count; ++i) part[i] = other[row + static_cast<std::size_t>(column + i)];
        for (int i = count; i < kLanes; ++i) part[i] = 0.0F;
        const Vec old = hn::Load(Float(), part);
        const Vec v = hn::MulAdd(between(shares, c, r, b, last, k), hn::Sub(load(x.at(column, y)), old), old);
        hn::Store(v, Float(), part);
        std::copy_n(part, count, out + row + static_cast<std::size_t>(column));
      }
    }
  }
}

// ------------------------------------------------------------------ the scene's model

double covariance(const double* time, const double* share, std::size_t count, double back, double at, double along,
                  double across) noexcept {
  using Double = hn::ScalableTag<double>;
  const Double d;
  constexpr std::size_t kStep = hn::MaxLanes(d);
  const auto add = [&](const double* t, const double* w, auto sum) HWY_ATTR {
    const auto when = hn::Add(hn::LoadU(d, t), hn::Set(d, back));
    const auto x = hn::MulAdd(hn::Set(d, along), when, hn::Set(d, at));
    const auto y = hn::Mul(hn::Set(d, across), when);
    const auto square = hn::MulAdd(x, x, hn::MulAdd(y, y, hn::Set(d, 0.36)));
    const auto distance = hn::Sub(hn::Sqrt(square), hn::Set(d, 0.6));
    const auto slow = hn::Exp(d, hn::Max(hn::Mul(distance, hn::Set(d, -1.0 / 30.0)), hn::Set(d, -100.0)));
    const auto cube = hn::Mul(hn::Mul(slow, slow), slow);
    return hn::MulAdd(hn::LoadU(d, w), hn::MulAdd(cube, cube, slow), sum);  // exp(-R / 5) is the sixth power
  };
  auto total = hn::Zero(d);
  std::size_t i = 0;
  for (; i + kStep <= count; i += kStep) total = add(time + i, share + i, total);
  if (i < count) {
    HWY_ALIGN double t[kStep] = {};
    HWY_ALIGN double w[kStep] = {};
    std::copy_n(time + i, count - i, t);
    std::copy_n(share + i, count - i, w);
    total = add(t, w, total);
  }
  return 0.5 * hn::GetLane(hn::SumOfLanes(d, total));
}

const Kernels& kernels() {
  static const Kernels table{HWY_TARGET == HWY_SCALAR ? "scalar" : hwy::TargetName(HWY_TARGET),
                             innovate,
                             smooth,
                             halve,
                             mean_difference,
                             match,
                             cost,
                             search,
                             energy,
                             align,
                             shift,
                             fit,
                             filter,
                             check,
                             correct,
                             blend,
                             covariance};
  return table;
}

}  // namespace bolo::motion::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace bolo::motion {
namespace {

HWY_EXPORT(kernels);

std::vector<const Kernels*> find_kernels() {
  std::vector<const Kernels*> found;
  std::int64_t left = (hwy::SupportedTargets() | HWY_STATIC_TARGET) & HWY_TARGETS;
  for (; left != 0; left &= left - 1) {
    hwy::SetSupportedTargetsForTest(left & -left);
    hwy::GetChosenTarget().DeInit();  // the next dispatch chooses again
    found.push_back(&HWY_DYNAMIC_DISPATCH(kernels)());
  }
  hwy::SetSupportedTargetsForTest(0);
  hwy::GetChosenTarget().DeInit();
  return found;
}

}  // namespace

const Kernels& best_kernels(std::string_view isa) {
  static const std::vector<const Kernels*> found = find_kernels();
  for (const Kernels* kernels : found) {
    if (isa.empty() || kernels->isa == isa) return *kernels;
  }
  return *found.back();
}

}  // namespace bolo::motion
#endif

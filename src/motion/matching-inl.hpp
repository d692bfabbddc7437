// How well blocks of two planes match. Included once for every instruction set.
#if defined(BOLO_MOTION_MATCHING_INL) == defined(HWY_TARGET_TOGGLE)
#ifdef BOLO_MOTION_MATCHING_INL
#undef BOLO_MOTION_MATCHING_INL
#else
#define BOLO_MOTION_MATCHING_INL
#endif

#include <algorithm>
#include <cmath>

#include "src/motion/block-inl.hpp"

HWY_BEFORE_NAMESPACE();
namespace bolo::motion::HWY_NAMESPACE {

constexpr std::ptrdiff_t kMovedStride = 16;
constexpr int kMoved = kBlock + 2;

// The block and one pixel around it, moved. The last vector of a row overlaps the one before.
HWY_INLINE void move_block(const PaddedPlane& a, int x0, int y0, Vec2 d, float* out) {
  const Source s = source_at(a, x0, y0, -d.x, -d.y);
  const float* from = a.at(x0 - 1, y0 - 1) + s.offset;
  for (int r = 0; r < kMoved; ++r) {
    const float* row = from + r * a.stride();
    for (int next = 0; next < kMoved; next += kLanes) {
      const int x = std::min(next, kMoved - kLanes);
      store(sample(row + x, a.stride(), s), out + r * kMovedStride + x);
    }
  }
}

HWY_INLINE MatchSums match_block(const PaddedPlane& a, const PaddedPlane& b, int x0, int y0, Vec2 d, float margin) {
  HWY_ALIGN float moved[kMoved * kMovedStride];
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

}  // namespace bolo::motion::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();
#endif

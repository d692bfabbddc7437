// Position and values of a moved block's source. Included once for every instruction set.
#if defined(BOLO_MOTION_BLOCK_INL) == defined(HWY_TARGET_TOGGLE)
#ifdef BOLO_MOTION_BLOCK_INL
#undef BOLO_MOTION_BLOCK_INL
#else
#define BOLO_MOTION_BLOCK_INL
#endif

#include <algorithm>
#include <cmath>
#include <cstdint>

#include <hwy/cache_control.h>
#include <hwy/highway.h>

#include "src/motion/cubic.hpp"
#include "src/motion/kernels.hpp"

HWY_BEFORE_NAMESPACE();
namespace bolo::motion::HWY_NAMESPACE {

namespace hn = hwy::HWY_NAMESPACE;
using Float = hn::CappedTag<float, kBlock>;
using Vec = hn::Vec<Float>;

inline constexpr int kLanes = static_cast<int>(hn::MaxLanes(Float()));

HWY_INLINE Vec all(float value) { return hn::Set(Float(), value); }
HWY_INLINE Vec load(const float* from) { return hn::LoadU(Float(), from); }
HWY_INLINE void store(Vec x, float* to) { hn::StoreU(x, Float(), to); }
HWY_INLINE float sum(Vec x) { return hn::GetLane(hn::SumOfLanes(Float(), x)); }
HWY_INLINE Vec between(Vec a, Vec b, Vec share) { return hn::MulAdd(share, hn::Sub(b, a), a); }
HWY_INLINE Vec count_from(float first) { return hn::Iota(Float(), first); }

// Blocks of a row of blocks are read one after the other, and their rows of pixels are too many for the hardware to
// foresee: asks for `rows` of those that come next.
HWY_INLINE void prefetch_next(const float* block, std::ptrdiff_t stride, int rows) {
  constexpr std::ptrdiff_t kNext = 4 * kBlock;
  for (int r = 0; r < rows; ++r) hwy::Prefetch(block + r * stride + kNext);
}

// A block's source: the whole part as an offset from the block, bilinear weights for the rest.
struct Source {
  std::ptrdiff_t offset;
  float w00;
  float w10;
  float w01;
  float w11;
};

// Beyond the rim a block of 12 x 12 around (x0, y0) would see the repeated border only: positions are clamped there.
// NaN becomes the lowest.
HWY_INLINE float lowest(int first) { return static_cast<float>(2 - kRim - first); }
HWY_INLINE float highest(int first, int blocks) {
  return static_cast<float>(blocks * kBlock + kRim - kBlock - 4 - first);
}
HWY_INLINE int limited(float whole, int first, int blocks) {
  return static_cast<int>(std::min(std::max(lowest(first), whole), highest(first, blocks)));
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

// The values of one vector's width of a moved block, row by row; every pixel is read once.
struct Sampler {
  const float* at;
  std::ptrdiff_t stride;
  Vec w00;
  Vec w10;
  Vec w01;
  Vec w11;
  Vec left;
  Vec right;

  // `from`: the block's first row, before it is moved.
  HWY_INLINE Sampler(const float* from, std::ptrdiff_t row, const Source& s)
      : at(from + s.offset),
        stride(row),
        w00(all(s.w00)),
        w10(all(s.w10)),
        w01(all(s.w01)),
        w11(all(s.w11)),
        left(load(at)),
        right(load(at + 1)) {}
  HWY_INLINE Vec next() {
    const Vec upper = hn::MulAdd(w10, right, hn::Mul(w00, left));
    at += stride;
    left = load(at);
    right = load(at + 1);
    return hn::MulAdd(w11, right, hn::MulAdd(w01, left, upper));
  }
};

// What values that are `step` apart are interpolated from, kReach of them on both sides of a block's pixels: the four
// pixels around one, or, where it lies on a row or a column, four of that.
struct Taps {
  static constexpr int kPadded = 16;
  HWY_ALIGN float fx[kPadded];
  HWY_ALIGN float fy[kPadded];
  HWY_ALIGN std::int32_t offset[kPadded];
  HWY_ALIGN float w[4][kPadded];
  std::ptrdiff_t stride;

  // For the block at (x0, y0). Whole parts are limited as in whole_of.
  HWY_INLINE Taps(const PaddedPlane& plane, int x0, int y0, Vec2 step) : stride(plane.stride()) {
    static_assert(kPadded >= kTaps);
    const hn::RebindToSigned<Float> whole;
    const auto part = [&](int j, float along, int first, int blocks, Vec& share) HWY_ATTR {
      const Vec s = hn::Mul(count_from(static_cast<float>(j - kReach)), all(along));
      const Vec floor = hn::Floor(s);
      share = hn::Sub(s, floor);
      const Vec low = all(lowest(first));
      const Vec high = all(highest(first, blocks));
      return hn::ConvertTo(whole, hn::Min(hn::IfThenElse(hn::Gt(floor, low), floor, low), high));
    };
    for (int j = 0; j < kPadded; j += kLanes) {
      Vec right;
      Vec down;
      const auto x = part(j, step.x, x0, plane.blocks_across(), right);
      const auto y = part(j, step.y, y0, plane.blocks_down(), down);
      const auto row = hn::Set(whole, static_cast<std::int32_t>(stride));
      hn::Store(hn::Add(hn::Mul(y, row), x), whole, offset + j);
      hn::Store(right, Float(), fx + j);
      hn::Store(down, Float(), fy + j);
      const Vec left = hn::Sub(all(1.0F), right);
      const Vec up = hn::Sub(all(1.0F), down);
      hn::Store(hn::Mul(left, up), Float(), w[0] + j);
      hn::Store(hn::Mul(right, up), Float(), w[1] + j);
      hn::Store(hn::Mul(left, down), Float(), w[2] + j);
      hn::Store(hn::Mul(right, down), Float(), w[3] + j);
    }
    for (int j = 0; j < kTaps; ++j) {
      if (linear(j)) continue;
      float four[4];
      cubic(fx[j] + fy[j], four);
      for (int i = 0; i < 4; ++i) w[i][j] = four[i];
    }
  }
  bool linear(int j) const { return fx[j] != 0.0F && fy[j] != 0.0F; }
  Source around(int j) const { return {offset[j], w[0][j], w[1][j], w[2][j], w[3][j]}; }
};

// Of a tap that is not linear.
HWY_INLINE Vec value_of(const float* at, const Taps& taps, int j) {
  const std::ptrdiff_t step = taps.fx[j] == 0.0F ? taps.stride : 1;
  const float* from = at + taps.offset[j] - step;
  Vec v = hn::Mul(all(taps.w[0][j]), load(from));
  for (int i = 1; i < 4; ++i) v = hn::MulAdd(all(taps.w[i][j]), load(from + i * step), v);
  return v;
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

}  // namespace bolo::motion::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();
#endif

// Position and values of a moved block's source. Included once for every instruction set.
#if defined(BOLO_MOTION_BLOCK_INL) == defined(HWY_TARGET_TOGGLE)
#ifdef BOLO_MOTION_BLOCK_INL
#undef BOLO_MOTION_BLOCK_INL
#else
#define BOLO_MOTION_BLOCK_INL
#endif

#include <algorithm>
#include <cmath>

#include <hwy/highway.h>

#include "src/motion/cubic.hpp"
#include "src/motion/kernels.hpp"

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
HWY_INLINE Vec between(Vec a, Vec b, Vec share) { return hn::MulAdd(share, hn::Sub(b, a), a); }
HWY_INLINE Vec count_from(float first) { return hn::Iota(Float(), first); }

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
HWY_INLINE int limited(float whole, int first, int blocks) {
  const float low = static_cast<float>(2 - kRim - first);
  const float high = static_cast<float>(blocks * kBlock + kRim - kBlock - 4 - first);
  return static_cast<int>(std::min(std::max(low, whole), high));
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

// Four pixels that a value between them is interpolated from.
struct Tap {
  std::ptrdiff_t offset[4];
  float w[4];
};

// Of p + s for the pixels p of the block at (x0, y0): the pixels around it, or, where s is whole along an axis, four
// along the other.
HWY_INLINE Tap tap_at(const PaddedPlane& plane, int x0, int y0, float sx, float sy) {
  const Whole s = whole_of(plane, x0, y0, sx, sy);
  const std::ptrdiff_t at = s.y * plane.stride() + s.x;
  Tap tap;
  if (s.fx == 0.0F || s.fy == 0.0F) {
    const std::ptrdiff_t step = s.fx == 0.0F ? plane.stride() : 1;
    for (int i = 0; i < 4; ++i) tap.offset[i] = at + (i - 1) * step;
    cubic(s.fx + s.fy, tap.w);
    return tap;
  }
  for (int i = 0; i < 4; ++i) {
    tap.offset[i] = at + (i % 2) + (i / 2) * plane.stride();
    tap.w[i] = (i % 2 != 0 ? s.fx : 1.0F - s.fx) * (i / 2 != 0 ? s.fy : 1.0F - s.fy);
  }
  return tap;
}

HWY_INLINE Vec value_of(const float* at, const Tap& tap) {
  Vec v = hn::Mul(all(tap.w[0]), load(at + tap.offset[0]));
  for (int i = 1; i < 4; ++i) v = hn::MulAdd(all(tap.w[i]), load(at + tap.offset[i]), v);
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

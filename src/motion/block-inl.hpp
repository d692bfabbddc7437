// Source position and values of a displaced block. Included once for every instruction set.
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

#include "src/motion/interpolation.hpp"
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

// Prefetches `rows` rows of the blocks that come next: a block's rows are too many streams for the hardware to predict.
HWY_INLINE void prefetch_next(const float* block, std::ptrdiff_t stride, int rows) {
  constexpr std::ptrdiff_t kNext = 4 * kBlock;
  for (int r = 0; r < rows; ++r) hwy::Prefetch(block + r * stride + kNext);
}

// A block's source: the whole part as an offset from the block, bilinear weights for the fraction.
struct Source {
  std::ptrdiff_t offset;
  float w00;
  float w10;
  float w01;
  float w11;
};

// Clamps positions: a block of 12 x 12 around (x0, y0) further out would see only the border. NaN becomes the lowest.
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

// Source of the pixels p + s, p in the block at (x0, y0).
HWY_INLINE Source source_at(const PaddedPlane& plane, int x0, int y0, float sx, float sy) {
  const Whole s = whole_of(plane, x0, y0, sx, sy);
  return {s.y * plane.stride() + s.x, (1 - s.fx) * (1 - s.fy), s.fx * (1 - s.fy), (1 - s.fx) * s.fy, s.fx * s.fy};
}

// Values of a displaced block, one vector wide, row by row; every pixel is read once.
struct Sampler {
  const float* at;
  std::ptrdiff_t stride;
  Vec w00;
  Vec w10;
  Vec w01;
  Vec w11;
  Vec left;
  Vec right;

  // `from`: the block's first row, not displaced.
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

// Interpolation of values `step` apart, kReach of them on both sides of a block's pixels. Linear interpolation would
// blur what the weights sharpen; further away, where weights are small, it suffices.
struct Taps {
  std::ptrdiff_t offset[kTaps];
  const float* of_row[kTaps];     // weights along a row; null where the value lies on a column
  const float* of_column[kTaps];  // the same along a column

  static constexpr int values_of(int j) {
    const int apart = j < kReach ? kReach - j : j - kReach;
    return apart <= 2 ? 6 : apart == 3 ? 4 : 2;
  }

  // For the block at (x0, y0). Whole parts are limited as in whole_of.
  HWY_INLINE Taps(const PaddedPlane& plane, int x0, int y0, Vec2 step) {
    constexpr int kParts = Kriging::kParts;
    const auto part = [](int j, float step_along, int first, int blocks, int& whole) HWY_ATTR {
      const float s = static_cast<float>(j - kReach) * step_along;
      const float in_reach = std::min(std::max(-1.0F * kReach, s), 1.0F * kReach);  // NaN becomes the lowest
      const auto parts = static_cast<int>((in_reach + kReach) * kParts + 0.5F);     // positive: truncation is floor
      whole = limited(static_cast<float>(parts / kParts - kReach), first, blocks);
      const auto row = static_cast<std::size_t>(parts % kParts);
      return row == 0 ? nullptr : kKriging.of(values_of(j), row);
    };
    for (int j = 0; j < kTaps; ++j) {
      int x = 0;
      int y = 0;
      of_row[j] = part(j, step.x, x0, plane.blocks_across(), x);
      of_column[j] = part(j, step.y, y0, plane.blocks_down(), y);
      offset[j] = y * plane.stride() + x;
    }
  }

  // put(row, values) for `kRows` rows from `at` on. Inline for each number of values.
  template <int kRows, typename Put>
  HWY_INLINE void values(int j, const float* at, std::ptrdiff_t stride, const Put& put) const {
    switch (values_of(j)) {
      case 2:
        return values_between<2, kRows>(j, at, stride, put);
      case 4:
        return values_between<4, kRows>(j, at, stride, put);
      default:
        return values_between<6, kRows>(j, at, stride, put);
    }
  }

 private:
  template <int kValues, int kRows, typename Put>
  HWY_INLINE void values_between(int j, const float* at, std::ptrdiff_t stride, const Put& put) const {
    constexpr int kBefore = kValues / 2 - 1;
    const auto sum = [](const float* w, const auto& value) HWY_ATTR {
      Vec v = hn::Mul(all(w[0]), value(0));
      HWY_UNROLL(8)
      for (int i = 1; i < kValues; ++i) v = hn::MulAdd(all(w[i]), value(i), v);
      return v;
    };
    const float* from = at + offset[j];
    const auto in_row = [&](int r) HWY_ATTR {
      const float* p = from + r * stride;
      if (of_row[j] == nullptr) return load(p);
      return sum(of_row[j], [&](int i) HWY_ATTR { return load(p + i - kBefore); });
    };
    if (of_column[j] == nullptr) {
      HWY_UNROLL(8)
      for (int r = 0; r < kRows; ++r) put(r, in_row(r));
      return;
    }
    constexpr int kRead = kRows + kValues - 1;
    Vec rows[std::size_t{kRead}];
    HWY_UNROLL(16)
    for (int r = 0; r < kRead; ++r) rows[r] = in_row(r - kBefore);
    HWY_UNROLL(8)
    for (int r = 0; r < kRows; ++r) put(r, sum(of_column[j], [&](int i) HWY_ATTR { return rows[r + i]; }));
  }
};

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

// Matching of blocks of two planes. Included once for every instruction set.
#if defined(BOLO_MOTION_MATCHING_INL) == defined(HWY_TARGET_TOGGLE)
#ifdef BOLO_MOTION_MATCHING_INL
#undef BOLO_MOTION_MATCHING_INL
#else
#define BOLO_MOTION_MATCHING_INL
#endif

#include <algorithm>
#include <cmath>

#include <hwy/contrib/math/math-inl.h>

#include "src/motion/block-inl.hpp"
#include "src/motion/innovation.hpp"

HWY_BEFORE_NAMESPACE();
namespace bolo::motion::HWY_NAMESPACE {

// Sobel sums of one row of a moved plane; every row is read once.
struct Slopes {
  Vec value;
  Vec across;  // right - left
  Vec smooth;  // left + 2 value + right

  HWY_INLINE Slopes(const float* at, Vec share) {
    const Vec here = load(at);
    const Vec next = load(at + 1);
    const Vec left = between(load(at - 1), here, share);
    const Vec right = between(next, load(at + 2), share);
    value = between(here, next, share);
    across = hn::Sub(right, left);
    smooth = hn::MulAdd(all(2.0F), value, hn::Add(left, right));
  }
  HWY_INLINE Slopes(const Slopes& upper, const Slopes& lower, Vec share)
      : value(between(upper.value, lower.value, share)),
        across(between(upper.across, lower.across, share)),
        smooth(between(upper.smooth, lower.smooth, share)) {}
};

struct MatchVectors {
  Vec xx;
  Vec xy;
  Vec yy;
  Vec xe;
  Vec ye;
  Vec ee;
  Vec count;

  HWY_INLINE MatchVectors() { xx = xy = yy = xe = ye = ee = count = hn::Zero(Float()); }
  HWY_INLINE void add(Vec gx, Vec gy, Vec e) {
    xx = hn::MulAdd(gx, gx, xx);
    xy = hn::MulAdd(gx, gy, xy);
    yy = hn::MulAdd(gy, gy, yy);
    xe = hn::MulAdd(gx, e, xe);
    ye = hn::MulAdd(gy, e, ye);
    ee = hn::MulAdd(e, e, ee);
  }
};

// `kWhole`: every pixel counts.
template <bool kWhole>
HWY_INLINE void add_matches(const PaddedPlane& a, const PaddedPlane& b, int x0, int y0, const Whole& from,
                            const Inside& inside, MatchVectors& sums) {
  const Vec right = all(from.fx);
  const Vec down = all(from.fy);
  prefetch_next(a.at(x0 + from.x, y0 + from.y), a.stride(), kBlock + 2);
  prefetch_next(b.at(x0, y0), b.stride(), kBlock);
  for (int x = x0; x < x0 + kBlock; x += kLanes) {
    const float* row = a.at(x + from.x, y0 + from.y - 1);
    const auto next = [&]() HWY_ATTR { return Slopes(row += a.stride(), right); };
    const Vec in = kWhole ? all(1.0F) : inside.mask(x);
    Slopes source = next();
    Slopes up(Slopes(row - a.stride(), right), source, down);
    Slopes lower = next();
    Slopes mid(source, lower, down);
    for (int y = y0; y < y0 + kBlock; ++y) {
      source = lower;
      lower = next();
      const Slopes low(source, lower, down);
      Vec gx = hn::MulAdd(all(2.0F), mid.across, hn::Add(up.across, low.across));
      Vec gy = hn::Sub(low.smooth, up.smooth);
      Vec e = hn::Sub(load(b.at(x, y)), mid.value);
      up = mid;
      mid = low;
      if constexpr (!kWhole) {
        if (!inside.row(y)) continue;
        gx = hn::Mul(gx, in);
        gy = hn::Mul(gy, in);
        e = hn::Mul(e, in);
        sums.count = hn::Add(sums.count, in);
      }
      sums.add(gx, gy, e);
    }
  }
}

HWY_INLINE MatchSums match_block(const PaddedPlane& a, const PaddedPlane& b, int x0, int y0, Vec2 d, float margin) {
  const Whole from = whole_of(a, x0, y0, -d.x, -d.y);
  const Inside inside(a.geometry(), d, margin);
  const bool whole = inside.whole(x0, y0);
  MatchVectors s;
  if (whole) {
    add_matches<true>(a, b, x0, y0, from, inside, s);
  } else {
    add_matches<false>(a, b, x0, y0, from, inside, s);
  }
  constexpr float kSobel = 1.0F / 8.0F;
  return {kSobel * kSobel * sum(s.xx),
          kSobel * kSobel * sum(s.xy),
          kSobel * kSobel * sum(s.yy),
          kSobel * sum(s.xe),
          kSobel * sum(s.ye),
          sum(s.ee),
          whole ? kBlock * kBlock : sum(s.count)};
}

void match(const PaddedPlane& a, const PaddedPlane& b, const Vec2* d, int block_row, float margin,
           MatchSums* out) noexcept {
  const int y0 = block_row * kBlock;
  for (int c = 0; c < a.blocks_across(); ++c) out[c] = match_block(a, b, c * kBlock, y0, d[c], margin);
}

// With s^2 the smoothing's variance, the shared noise has the autocovariance of a Gaussian of variance 2 s^2, widened
// by moving (linear interpolation) and the gradient: a mean over 2 pixels along, (1 2 1) / 4 across. Its derivative
// enters.
HWY_INLINE Vec pull_along(Vec along, Vec across, Vec shared) {
  const auto widened = [](Vec v, float by) HWY_ATTR {
    const Vec part = hn::Sub(v, hn::Floor(v));
    return hn::MulAdd(part, hn::Sub(all(1.0F), part), all(2.0F * kSmoothing + by));
  };
  const Vec a = widened(along, 1.0F / 3.0F);
  const Vec b = widened(across, 1.0F / 2.0F);
  const Vec height = hn::Div(shared, hn::Mul(hn::Sqrt(hn::Mul(a, b)), a));
  const Vec square = hn::Add(hn::Div(hn::Mul(along, along), a), hn::Div(hn::Mul(across, across), b));
  return hn::Mul(hn::Mul(height, along), hn::Exp(Float(), hn::Mul(all(-0.5F), square)));
}

void pull(const Vec2* d, int count, float shared, Vec2* out) noexcept {
  constexpr float kFar = 50.0F;  // px^2: negligible beyond
  for (int first = 0; first < count; first += kLanes) {
    const int together = std::min(kLanes, count - first);
    HWY_ALIGN float x[kLanes] = {};
    HWY_ALIGN float y[kLanes] = {};
    for (int i = 0; i < together; ++i) {
      x[i] = d[first + i].x;
      y[i] = d[first + i].y;
    }
    const Vec dx = hn::Load(Float(), x);
    const Vec dy = hn::Load(Float(), y);
    const auto near = hn::Le(hn::MulAdd(dx, dx, hn::Mul(dy, dy)), all(kFar));
    hn::Store(hn::IfThenElseZero(near, pull_along(dx, dy, all(shared))), Float(), x);
    hn::Store(hn::IfThenElseZero(near, pull_along(dy, dx, all(shared))), Float(), y);
    for (int i = 0; i < together; ++i) out[first + i] = {x[i], y[i]};
  }
}

void cost(const PaddedPlane& a, const PaddedPlane& b, const Vec2* d, int block_row, float cap, float* out) noexcept {
  const int y0 = block_row * kBlock;
  for (int c = 0; c < a.blocks_across(); ++c) {
    const int x0 = c * kBlock;
    const Source s = source_at(a, x0, y0, -d[c].x, -d[c].y);
    Vec total = hn::Zero(Float());
    for (int x = 0; x < kBlock; x += kLanes) {
      Sampler moved(a.at(x0 + x, y0), a.stride(), s);
      for (int r = 0; r < kBlock; ++r) {
        const Vec e = hn::Sub(load(b.at(x0 + x, y0 + r)), moved.next());
        total = hn::Add(total, hn::Min(hn::Mul(e, e), all(cap)));
      }
    }
    out[c] = sum(total) / (kBlock * kBlock);
  }
}

constexpr int kSearchAcross = 9;
constexpr int kSearchDown = 5;
constexpr int kSide = 12;  // of the half-size window
constexpr int kPatchRows = kSide + 2 * kSearchDown;
constexpr int kPlaces = 3 * kBlock;             // across, in whole vectors
constexpr int kPatchColumns = kSide + kPlaces;  // that are read
static_assert(kPlaces > 2 * kSearchAcross);
constexpr std::ptrdiff_t kPatchStride = kPatchColumns;

// Values of a plane at p - d for a patch from (x0, y0) on; beyond the frame the border is repeated.
HWY_INLINE void move_patch(const PaddedPlane& a, int x0, int y0, Vec2 d, float* out) {
  const float ix = std::floor(-d.x);
  const float iy = std::floor(-d.y);
  const Vec fx = all(-d.x - ix);
  const Vec fy = all(-d.y - iy);
  const auto whole = [](float v) { return static_cast<int>(std::max(-1e6F, std::min(1e6F, v))); };  // also for NaN
  const int left = x0 + whole(ix);
  const int top = y0 + whole(iy);
  const Geometry g = a.geometry();
  const bool in_rim = left >= -kRim && left + kPatchColumns + kBlock < static_cast<int>(a.stride()) - kRim;
  HWY_ALIGN float rows[2][kPatchColumns + kBlock];
  for (int r = 0; r < kPatchRows; ++r) {
    const float* lines[2];
    for (int i = 0; i < 2; ++i) {
      const float* line = a.at(0, std::clamp(top + r + i, 0, g.height - 1));
      lines[i] = line + left;
      if (in_rim) continue;
      for (int c = 0; c <= kPatchColumns; ++c) rows[i][c] = line[std::clamp(left + c, 0, g.width - 1)];
      lines[i] = rows[i];
    }
    const auto down = [&](int c) HWY_ATTR { return between(load(lines[0] + c), load(lines[1] + c), fy); };
    for (int next = 0; next < kPatchColumns; next += kLanes) {
      const int c = std::min(next, kPatchColumns - kLanes);
      store(between(down(c), down(c + 1), fx), out + r * kPatchStride + c);
    }
  }
}

// Sums of squared differences for every place across, from right to left, at `down` rows below the patch's first.
HWY_INLINE void differences(const float* patch, const float* const* rows, int down, float* out) {
  constexpr int kVectors = kPlaces / kLanes;
  Vec total[kVectors];
  for (Vec& t : total) t = hn::Zero(Float());
  for (int r = 0; r < kSide; ++r) {
    for (int x = 0; x < kSide; ++x) {
      const Vec value = all(rows[r][x]);
      const float* p = patch + (r + down) * kPatchStride + x;
      for (int i = 0; i < kVectors; ++i) {
        const Vec e = hn::Sub(value, load(p + i * kLanes));
        total[i] = hn::MulAdd(e, e, total[i]);
      }
    }
  }
  for (int i = 0; i < kVectors; ++i) store(total[i], out + i * kLanes);
}

Vec2 search(const PaddedPlane& a, const PaddedPlane& b, int column, int row, Vec2 d, float price) noexcept {
  const int x0 = column * (kBlock / 2) - (kSide - kBlock / 2) / 2;
  const int y0 = row * (kBlock / 2) - (kSide - kBlock / 2) / 2;
  HWY_ALIGN float patch[kPatchRows * kPatchStride];
  HWY_ALIGN float errors[kPlaces];
  move_patch(a, x0 - kSearchAcross, y0 - kSearchDown, d, patch);
  const float* rows[kSide];
  for (int r = 0; r < kSide; ++r) rows[r] = b.at(x0, std::clamp(y0 + r, 0, b.geometry().height - 1));
  float best = 1e30F;
  Vec2 found;
  for (int sy = -kSearchDown; sy <= kSearchDown; ++sy) {
    differences(patch, rows, kSearchDown - sy, errors);
    for (int sx = -kSearchAcross; sx <= kSearchAcross; ++sx) {
      const float error = errors[kSearchAcross - sx] / (kSide * kSide) + price * static_cast<float>(sx * sx + sy * sy);
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

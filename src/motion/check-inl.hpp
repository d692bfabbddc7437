// Check of an estimate against the frame, correction, blending. Included once for every instruction set.
#if defined(BOLO_MOTION_CHECK_INL) == defined(HWY_TARGET_TOGGLE)
#ifdef BOLO_MOTION_CHECK_INL
#undef BOLO_MOTION_CHECK_INL
#else
#define BOLO_MOTION_CHECK_INL
#endif

#include <algorithm>
#include <cmath>

#include "src/motion/estimate-inl.hpp"
#include "src/motion/innovation.hpp"

HWY_BEFORE_NAMESPACE();
namespace bolo::motion::HWY_NAMESPACE {

constexpr int kFewestSteps = 3;
constexpr int kMostSteps = 30;

constexpr float kShort = 1.0F;  // px of a trail: up to it, interpolation blur is compensated in full;
constexpr float kLong = 5.0F;   // from here on not at all: the trail itself blurs more

HWY_INLINE int steps_of(Vec2 d) {
  const float length = std::sqrt(d.x * d.x + d.y * d.y);
  return std::clamp(static_cast<int>(std::ceil(length)), kFewestSteps, kMostSteps);
}

// Shares of a trail's steps, the newest first.
HWY_INLINE void share_steps(int steps, float ratio, float* share) {
  float total = 0.0F;
  for (int i = 0; i < steps; ++i) {
    share[i] = std::exp(-ratio * (static_cast<float>(i) + 0.5F) / static_cast<float>(steps));
    total += share[i];
  }
  for (int i = 0; i < steps; ++i) share[i] /= total;
}

// Adds to a block what a blur of `blur` (variance, px^2, along both axes) took off the values at `from`.
HWY_INLINE void add_sharpness(const float* from, std::ptrdiff_t stride, Vec2 blur, BlockSum& block) {
  const Vec across = all(-0.5F * blur.x);
  const Vec down = all(-0.5F * blur.y);
  const Vec middle = all(blur.x + blur.y);
  for (int r = 0; r < kBlock; ++r) {
    for (int k = 0; k < kBlock; k += kLanes) {
      const float* p = from + r * stride + k;
      Vec v = hn::MulAdd(middle, load(p), block.row[r][k / kLanes]);
      v = hn::MulAdd(across, hn::Add(load(p - 1), load(p + 1)), v);
      block.row[r][k / kLanes] = hn::MulAdd(down, hn::Add(load(p - stride), load(p + stride)), v);
    }
  }
}

void check(const PaddedPlane& x, const PaddedPlane& z, const PaddedPlane& y, const Vec2* d, float ratio, int block_row,
           PaddedPlane& left, float* left_square, float* change_square) noexcept {
  const int y0 = block_row * kBlock;
  float share[kMostSteps];
  int steps = 0;
  for (int c = 0; c < x.blocks_across(); ++c) {
    const int x0 = c * kBlock;
    if (const int here = steps_of(d[c]); here != steps) share_steps(steps = here, ratio, share);
    for (const PaddedPlane* plane : {&x, &y, &z}) prefetch_next(plane->at(x0, y0), plane->stride(), kBlock);
    const float length = std::sqrt(d[c].x * d[c].x + d[c].y * d[c].y);
    const float counts = std::clamp((kLong - length) / (kLong - kShort), 0.0F, 1.0F);
    BlockSum blurred;
    Vec2 middle;
    Vec2 blur;  // by linear interpolation, px^2
    for (int i = 0; i < steps; ++i) {
      const float f = (static_cast<float>(i) + 0.5F) / static_cast<float>(steps);
      const Vec2 at = d[c] * f;
      Source s = source_at(x, x0, y0, at.x, at.y);
      middle = middle + at * share[i];
      blur = blur + Vec2{spread_by_moving(at.x), spread_by_moving(at.y)} * (share[i] * counts);
      s.w00 *= share[i];
      s.w10 *= share[i];
      s.w01 *= share[i];
      s.w11 *= share[i];
      for (int k = 0; k < kBlock; k += kLanes) {
        Sampler moved(x.at(x0 + k, y0), x.stride(), s);
        HWY_UNROLL(8)
        for (int r = 0; r < kBlock; ++r) blurred.row[r][k / kLanes] = hn::Add(blurred.row[r][k / kLanes], moved.next());
      }
    }
    if (counts > 0.0F) {
      const Source s = source_at(x, x0, y0, std::floor(middle.x + 0.5F), std::floor(middle.y + 0.5F));
      add_sharpness(x.at(x0, y0) + s.offset, x.stride(), blur, blurred);
    }
    Vec residual = hn::Zero(Float());
    Vec change = residual;
    for (int r = 0; r < kBlock; ++r) {
      for (int k = 0; k < kBlock; k += kLanes) {
        const Vec innovation = load(z.at(x0 + k, y0 + r));
        const Vec e = hn::Sub(innovation, blurred.row[r][k / kLanes]);
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

// The first `count` values at `from`, then zeros.
HWY_INLINE Vec load_some(const float* from, int count) {
  if (count >= kLanes) return load(from);
  HWY_ALIGN float part[kLanes] = {};
  std::copy_n(from, std::max(count, 0), part);
  return hn::Load(Float(), part);
}

void distance(const PaddedPlane& x, const float* other, int block_row, float* square) noexcept {
  const Geometry g = x.geometry();
  const RowRange rows = x.rows_of(block_row);
  for (int c = 0; c < x.blocks_across(); ++c) {
    const int columns = std::min(kBlock, g.width - c * kBlock);
    Vec total = hn::Zero(Float());
    for (int y = rows.begin; y < rows.end; ++y) {
      const float* beside = other + static_cast<std::size_t>(y) * static_cast<std::size_t>(g.width);
      for (int k = 0; k < columns; k += kLanes) {
        const Vec mine = load_some(x.at(c * kBlock + k, y), columns - k);
        const Vec apart = hn::Sub(mine, load_some(beside + c * kBlock + k, columns - k));
        total = hn::MulAdd(apart, apart, total);
      }
    }
    square[c] = sum(total) / static_cast<float>(columns * (rows.end - rows.begin));
  }
}

// Values of a block field along a row of pixels, interpolated between block centres; block by block, from `first` on.
class Between {
 public:
  HWY_INLINE Between(const Shares& shares, const float* const* rows, int r, int first, int last)
      : shares_(shares),
        near_(shares.before[r] > 0.0F ? rows[0] : rows[2]),
        middle_(rows[1]),
        share_(shares.beside[r]),
        column_(first),
        last_(last),
        before_(value(std::max(first - 1, 0))),
        here_(value(first)),
        after_(value(std::min(first + 1, last))) {}
  HWY_INLINE Vec at(int x) const {
    Vec v = hn::Mul(hn::Load(Float(), shares_.before + x), all(before_));
    v = hn::MulAdd(hn::Load(Float(), shares_.here + x), all(here_), v);
    return hn::MulAdd(hn::Load(Float(), shares_.after + x), all(after_), v);
  }
  HWY_INLINE void go_on() {
    before_ = here_;
    here_ = after_;
    after_ = value(std::min(++column_ + 1, last_));
  }

 private:
  HWY_INLINE float value(int column) const { return middle_[column] + share_ * (near_[column] - middle_[column]); }

  const Shares& shares_;
  const float* near_;
  const float* middle_;
  float share_;
  int column_;
  int last_;
  float before_;
  float here_;
  float after_;
};

void correct(const PaddedPlane& left, const float* const* w, int block_row, Columns columns, PaddedPlane& x) noexcept {
  const Shares shares;
  const int last = x.blocks_across() - 1;
  for (int r = 0; r < kBlock; ++r) {
    Between share(shares, w, r, columns.begin, last);
    for (int c = columns.begin; c < columns.end; ++c, share.go_on()) {
      for (int k = 0; k < kBlock; k += kLanes) {
        float* to = x.at(c * kBlock + k, block_row * kBlock + r);
        const Vec e = load(left.at(c * kBlock + k, block_row * kBlock + r));
        store(hn::MulAdd(share.at(k), e, load(to)), to);
      }
    }
  }
}

void blend(const PaddedPlane& x, const float* other, const float* const* c, const float* most, int block_row,
           float* out) noexcept {
  const Shares shares;
  const Geometry g = x.geometry();
  const int last = x.blocks_across() - 1;
  const int rows = std::min(kBlock, g.height - block_row * kBlock);
  for (int r = 0; r < rows; ++r) {
    const int y = block_row * kBlock + r;
    const std::size_t row = static_cast<std::size_t>(y) * static_cast<std::size_t>(g.width);
    Between of_x(shares, c, r, 0, last);
    for (int b = 0; b <= last; ++b, of_x.go_on()) {
      for (int k = 0; k < kBlock; k += kLanes) {
        const int column = b * kBlock + k;
        const int count = std::min(kLanes, g.width - column);
        if (count <= 0) break;
        const std::size_t at = row + static_cast<std::size_t>(column);
        const Vec share = hn::Min(of_x.at(k), all(most[b]));
        const auto mixed = [&](Vec old) HWY_ATTR { return between(old, load(x.at(column, y)), share); };
        if (count == kLanes) {
          store(mixed(load(other + at)), out + at);
          continue;
        }
        HWY_ALIGN float part[kLanes];
        hn::Store(mixed(load_some(other + at, count)), Float(), part);
        std::copy_n(part, count, out + at);
      }
    }
  }
}

}  // namespace bolo::motion::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();
#endif

#include "src/motion/kernels.hpp"

#include <algorithm>
#include <cmath>

#include "src/core/simd_targets.hpp"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "src/motion/kernels.cpp"
#include <hwy/foreach_target.h>
#include <hwy/highway.h>

#include <hwy/contrib/math/math-inl.h>

#include "src/motion/check-inl.hpp"
#include "src/motion/estimate-inl.hpp"
#include "src/motion/matching-inl.hpp"
#include "src/motion/targets.hpp"

HWY_BEFORE_NAMESPACE();
namespace bolo::motion::HWY_NAMESPACE {

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

// Excess of a value over both its neighbours on one line, up or down.
HWY_INLINE Vec beyond_both(Vec value, Vec a, Vec b) {
  return hn::Max(hn::Sub(hn::Min(a, b), value), hn::Sub(value, hn::Max(a, b)));
}

int next_extreme(const float* row, std::ptrdiff_t stride, int x, int end, float least) noexcept {
  for (; x < end; x += kLanes) {
    const float* at = row + x;
    const Vec value = load(at);
    const Vec along = beyond_both(value, load(at - 1), load(at + 1));
    const Vec down = beyond_both(value, load(at - stride), load(at + stride));
    const auto found = hn::FindFirstTrue(Float(), hn::Gt(hn::Min(along, down), all(least)));
    if (found >= 0) return std::min(x + static_cast<int>(found), end);
  }
  return end;
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

// exp(-R / 30) + exp(-R / 5) for R = root - smooth: twice the scene's autocovariance (weights.hpp).
template <typename D, typename V>
HWY_INLINE V twice_autocovariance(D d, V root, float smooth) {
  const hn::RebindToSigned<D> whole;
  constexpr float kPerPixel = 1.44269504F / 30.0F;  // powers of 2
  const auto set = [&](float v) HWY_ATTR { return hn::Set(d, v); };
  const V power = hn::Max(hn::MulAdd(root, set(-kPerPixel), set(smooth * kPerPixel)), set(-120.0F));
  const V nearest = hn::Round(power);
  const V f = hn::Sub(power, nearest);
  V slow = set(0.00015345812F);  // 2^f to 2e-9, apart from rounding
  for (const float c : {0.0013399931F, 0.009618489F, 0.055503286F, 0.24022646F, 0.6931472F, 1.0F}) {
    slow = hn::MulAdd(slow, f, set(c));
  }
  slow = hn::BitCast(d, hn::Add(hn::BitCast(whole, slow), hn::ShiftLeft<23>(hn::ConvertTo(whole, nearest))));
  const V cube = hn::Mul(hn::Mul(slow, slow), slow);
  return hn::MulAdd(cube, cube, slow);
}

double covariance(const float* share, std::size_t count, double x, double dx, double y, double dy,
                  float smooth) noexcept {
  using Wide = hn::CappedTag<float, 16>;
  const Wide d;
  constexpr std::size_t kStep = hn::MaxLanes(d);
  constexpr std::size_t kRun = 64 * kStep;  // values that are added up in single precision
  constexpr double kFar = 500.0;            // px, beyond which the scene is uncorrelated
  // Steps are counted from the closest approach, where precision matters most.
  const auto all = static_cast<double>(count);
  const double nearest = dx == 0.0 ? 0.0 : std::clamp(std::round(-x / dx), 0.0, all);
  const double reach = dx == 0.0 ? all : std::ceil(kFar / std::abs(dx));
  const auto end = static_cast<std::size_t>(std::min(nearest + reach, all));
  const auto x0 = hn::Set(d, static_cast<float>(x + nearest * dx));
  const auto y0 = hn::Set(d, static_cast<float>(y + nearest * dy));
  const auto add = [&](const float* w, double first, auto sum) HWY_ATTR {
    const auto step = hn::Iota(d, static_cast<float>(first - nearest));
    const auto at = hn::MulAdd(hn::Set(d, static_cast<float>(dx)), step, x0);
    const auto across = hn::MulAdd(hn::Set(d, static_cast<float>(dy)), step, y0);
    const auto square = hn::MulAdd(at, at, hn::MulAdd(across, across, hn::Set(d, smooth * smooth)));
    return hn::MulAdd(hn::LoadU(d, w), twice_autocovariance(d, hn::Sqrt(square), smooth), sum);
  };
  double total = 0.0;
  auto i = static_cast<std::size_t>(std::max(nearest - reach, 0.0));
  while (i + kStep <= end) {
    auto sum = hn::Zero(d);
    const std::size_t until = std::min(i + kRun, end);
    for (; i + kStep <= until; i += kStep) sum = add(share + i, static_cast<double>(i), sum);
    total += static_cast<double>(hn::GetLane(hn::SumOfLanes(d, sum)));
  }
  if (i < end) {
    HWY_ALIGN float w[kStep] = {};
    std::copy_n(share + i, end - i, w);
    total += static_cast<double>(hn::GetLane(hn::SumOfLanes(d, add(w, static_cast<double>(i), hn::Zero(d)))));
  }
  return 0.5 * total;
}

void correlate(const SceneTrail& a, const SceneTrail& b, Vec2 step, int first, int count, float smooth,
               double* out) noexcept {
  using Wide = hn::CappedTag<float, 16>;
  const Wide d;
  constexpr int kStep = static_cast<int>(hn::MaxLanes(d));
  const auto set = [&](float v) HWY_ATTR { return hn::Set(d, v); };
  for (int j = 0; j < count; ++j) {
    const float dx = static_cast<float>(first + j) * step.x;
    const float dy = static_cast<float>(first + j) * step.y;
    auto sum = hn::Zero(d);
    for (int n = 0; n < a.count; ++n) {
      auto of_n = hn::Zero(d);
      for (int m = 0; m < b.count; m += kStep) {
        const auto x = hn::Sub(set(a.x[n] + dx), hn::Load(d, b.x + m));
        const auto y = hn::Sub(set(a.y[n] + dy), hn::Load(d, b.y + m));
        const auto doubt = hn::Sub(set(a.doubt[n]), hn::Load(d, b.doubt + m));
        const auto blur = hn::Add(set(a.blur[n] + smooth * smooth), hn::Load(d, b.blur + m));
        const auto square = hn::MulAdd(x, x, hn::MulAdd(y, y, hn::MulAdd(doubt, doubt, blur)));
        auto one_over = hn::ApproximateReciprocalSqrt(square);        // of 14 bits with AVX-512, else 8 at least
        for (int k = 0; k < (HWY_TARGET == HWY_AVX3 ? 1 : 2); ++k) {  // Newton
          const auto half = hn::Mul(hn::Mul(set(-0.5F), square), one_over);
          one_over = hn::Mul(one_over, hn::MulAdd(half, one_over, set(1.5F)));
        }
        const auto value = twice_autocovariance(d, hn::Mul(square, one_over), smooth);
        of_n = hn::MulAdd(hn::Load(d, b.share + m), value, of_n);
      }
      sum = hn::MulAdd(set(a.share[n]), of_n, sum);
    }
    out[j] = 0.5 * static_cast<double>(hn::GetLane(hn::SumOfLanes(d, sum)));
  }
}

const Kernels& kernels() {
  static const Kernels table{HWY_TARGET == HWY_SCALAR ? "scalar" : hwy::TargetName(HWY_TARGET),
                             innovate,
                             smooth,
                             halve,
                             next_extreme,
                             mean_difference,
                             match,
                             pull,
                             cost,
                             search,
                             energy,
                             align,
                             shift,
                             differ,
                             fit,
                             mix,
                             filter,
                             across,
                             check,
                             distance,
                             correct,
                             blend,
                             correlate,
                             covariance};
  return table;
}

}  // namespace bolo::motion::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace bolo::motion {

HWY_EXPORT(kernels);

const Kernels& best_kernels(std::string_view isa) {
  static const auto found =
      tables_of_targets(HWY_TARGETS, []() -> const Kernels& { return HWY_DYNAMIC_DISPATCH(kernels)(); });
  return table_for(found, isa);
}

}  // namespace bolo::motion
#endif

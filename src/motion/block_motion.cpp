#include "src/motion/block_motion.hpp"

#include <algorithm>
#include <cmath>

namespace bolo::motion {
namespace {

constexpr float kBlockPixels = kBlock * kBlock;
constexpr float kIndependentSamples = 36.0F;         // independent samples in 24 x 24 smoothed pixels
constexpr float kGradientNoise = 0.5F / kSmoothing;  // squared gradient of smoothed noise, in units of its variance
constexpr float kHalfSure = 0.25F;                   // px: standard error at a confidence of 1/2

float confidence_of(float xx, float xy, float yy, float left, float misfit, float noise) noexcept {
  const float middle = 0.5F * (xx + yy);
  const float least = middle - std::hypot(0.5F * (xx - yy), xy) - kGradientNoise * noise;  // smaller eigenvalue
  if (!(least > 0.0F)) return 0.0F;
  const float error = std::max(left, 2.0F * noise) / (kIndependentSamples * least);
  const float unlike = misfit * misfit;
  return 1.0F / ((1.0F + error / (kHalfSure * kHalfSure)) * (1.0F + unlike * unlike));
}

}  // namespace

BlockMotions::BlockMotions(Geometry geometry) : geometry_(geometry), found_(geometry) {
  const int across = found_.size.width;
  const int down = found_.size.height;
  trail_ = VectorField(across, down);
  for (std::size_t k = 0; k < raw_.size(); ++k) raw_[k] = mean_[k] = ScalarField(across, down);
}

void BlockMotions::find(const Inertia& inertia, const BlockMotionInputs& in) noexcept {
  spread(in.trail, geometry_, 1, trail_);
  const auto noise = static_cast<float>(inertia.noise() * in.noise * in.noise * kSmoothedNoise);
  for (std::size_t i = 0; i < in.sums.size(); ++i) {
    const MatchSums& s = in.sums[i];
    const std::array values{s.xx, s.xy, s.yy, s.ee};
    for (std::size_t k = 0; k < values.size(); ++k) raw_[k][i] = values[k] / kBlockPixels;
  }
  for (int row = 0; row < in.sums.down(); ++row) {
    for (std::size_t k = 0; k < raw_.size(); ++k) mean_of_9(raw_[k], row, mean_[k]);
  }
  for (std::size_t i = 0; i < trail_.size(); ++i) {
    const Vec2 v = trail_[i] + in.deviation[i];
    found_.blocks[i] = {v.x, v.y,
                        confidence_of(mean_[0][i], mean_[1][i], mean_[2][i], mean_[3][i], in.misfit[i], noise)};
  }
  const double per_pixel = 2.0 / geometry_.width;  // an Affine counts halves of the frame's width
  const std::array<double, 6>& p = in.trail.p;
  found_.affine = {p[0], p[1] * per_pixel, p[2] * per_pixel, p[3], p[4] * per_pixel, p[5] * per_pixel};
}

}  // namespace bolo::motion

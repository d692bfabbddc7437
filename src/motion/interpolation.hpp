// Interpolation between four values, and between six.
#pragma once

namespace bolo::motion {

// Keys' kernel with a = -0.75: weights of the values at -1, 0, 1 and 2 for a point f after 0. Thread: any.
[[gnu::always_inline]] inline void cubic(float f, float* w) {
  constexpr float a = -0.75F;
  const auto far = [](float t) { return ((a * t - 5 * a) * t + 8 * a) * t - 4 * a; };
  const auto near = [](float t) { return ((a + 2) * t - (a + 3)) * t * t + 1; };
  w[0] = far(f + 1);
  w[1] = near(f);
  w[2] = near(1 - f);
  w[3] = 1.0F - w[0] - w[1] - w[2];
}

// Weights of the values at -kBefore, 1 - kBefore ... for points in steps of 1 / kParts after 0: of those with unit sum
// they leave the least mean square error (kriging) of a scene whose autocovariance is a Gaussian of 1.2 px, with
// noise of a thousandth of its variance. Of these, bands of 0.35 and 0.42 cycles a px, the covariance of weights.hpp
// and Lanczos' kernel, these made pans aslant and hands sharpest.
struct SixWeights {
  static constexpr int kParts = 64;
  static constexpr int kBefore = 2;
  static constexpr int kValues = 6;
  float w[kParts][kValues + 2];

  SixWeights();
};
extern const SixWeights kSixWeights;

}  // namespace bolo::motion

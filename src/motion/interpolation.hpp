// Interpolation between values a pixel apart.
#pragma once

#include <cstddef>

namespace bolo::motion {

// Keys' kernel: weights of the values at -1, 0, 1 and 2 for a point f after 0. Thread: any.
inline constexpr float kKeys = -0.75F;
[[gnu::always_inline]] inline void cubic(float f, float* w) {
  constexpr float a = kKeys;
  const auto far = [](float t) { return ((a * t - 5 * a) * t + 8 * a) * t - 4 * a; };
  const auto near = [](float t) { return ((a + 2) * t - (a + 3)) * t * t + 1; };
  w[0] = far(f + 1);
  w[1] = near(f);
  w[2] = near(1 - f);
  w[3] = 1.0F - w[0] - w[1] - w[2];
}

// Kriging weights of the nearest six, four and two values for points in steps of 1 / kParts after the last value of the
// first half: unit sum, and the least mean square error for a scene whose autocovariance is a Gaussian of 1.2 px, with
// noise of a thousandth of its variance. Compared with bands of 0.35 and 0.42 cycles a px, the covariance of
// weights.hpp and Lanczos' kernel, these left slanted pans and hand motion sharpest.
struct Kriging {
  static constexpr int kParts = 64;
  static constexpr int kMost = 6;
  float w[3][kParts][kMost + 2];

  Kriging();
  const float* of(int values, std::size_t part) const noexcept { return w[(kMost - values) / 2][part]; }
};
extern const Kriging kKriging;

}  // namespace bolo::motion

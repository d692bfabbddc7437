// Interpolation between four values.
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

}  // namespace bolo::motion

#include "src/sim/pixel.hpp"

#include <array>
#include <cmath>

namespace bolo::sim {
namespace {

// m[k] = integral over s from 0 to 1 of z exp(-z (1 - s)) s^k: the answer to T_ss = s^k after a step of z = h / tau.
std::array<double, 3> moments(double z) noexcept {
  std::array<double, 3> m{};
  if (z > 0.5) {
    m[0] = -std::expm1(-z);
    m[1] = 1.0 - m[0] / z;
    m[2] = 1.0 - 2.0 * m[1] / z;
    return m;
  }
  // The differences above cancel for small z; the series m[k] = sum over j of -(-z)^(j+1) k! / (k + j + 1)! does not.
  constexpr int kTerms = 14;  // 0.5^14 / 15! is below the last bit
  for (int k = 0; k < 3; ++k) {
    double term = z / (k + 1);
    for (int j = 1; j <= kTerms; ++j) {
      m[static_cast<std::size_t>(k)] += term;
      term *= -z / (k + 1 + j);
    }
  }
  return m;
}

}  // namespace

StepWeights bolometer_step(double duration_s, double tau_s) noexcept {
  const double z = duration_s / tau_s;
  const auto m = moments(z);
  // The quadratic through the three values: (2s^2 - 3s + 1) start + (4s - 4s^2) middle + (2s^2 - s) end.
  return {std::exp(-z), 2.0 * m[2] - 3.0 * m[1] + m[0], 4.0 * (m[1] - m[2]), 2.0 * m[2] - m[1]};
}

StepWeights exposure_step(double duration_s, double exposure_s) noexcept {
  const double share = duration_s / exposure_s;
  return {1.0, share / 6.0, share * 4.0 / 6.0, share / 6.0};
}

}  // namespace bolo::sim

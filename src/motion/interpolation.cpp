#include "src/motion/interpolation.hpp"

#include <cmath>

#include <Eigen/Dense>

namespace bolo::motion {
namespace {

constexpr double kLikeOver = 1.2;  // px
constexpr double kUnlike = 1e-3;   // of the scene's variance

double likeness(double apart) { return std::exp(-0.5 * apart * apart / (kLikeOver * kLikeOver)); }

}  // namespace

SixWeights::SixWeights() : w{} {
  Eigen::Matrix<double, kValues, kValues> values;
  for (int i = 0; i < kValues; ++i) {
    for (int j = 0; j < kValues; ++j) values(i, j) = likeness(i - j) + (i == j ? kUnlike : 0.0);
  }
  using Vector = Eigen::Matrix<double, kValues, 1>;
  const Eigen::LDLT<decltype(values)> factors(values);
  const Vector b = factors.solve(Vector::Ones());
  for (int part = 0; part < kParts; ++part) {
    Vector truth;
    for (int i = 0; i < kValues; ++i) truth(i) = likeness(i - kBefore - static_cast<double>(part) / kParts);
    const Vector a = factors.solve(truth);
    const Vector best = a + (1.0 - a.sum()) / b.sum() * b;
    for (int i = 0; i < kValues; ++i) w[part][i] = static_cast<float>(best(i));
  }
}

const SixWeights kSixWeights;

}  // namespace bolo::motion

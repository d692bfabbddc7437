#include "src/motion/interpolation.hpp"

#include <cmath>

#include <Eigen/Dense>

namespace bolo::motion {
namespace {

constexpr double kLikeOver = 1.2;  // px
constexpr double kUnlike = 1e-3;   // of the scene's variance

double likeness(double apart) { return std::exp(-0.5 * apart * apart / (kLikeOver * kLikeOver)); }

}  // namespace

Kriging::Kriging() : w{} {
  for (int kind = 0; kind < 3; ++kind) {
    const int n = kMost - 2 * kind;
    Eigen::MatrixXd values(n, n);
    for (int i = 0; i < n; ++i) {
      for (int j = 0; j < n; ++j) values(i, j) = likeness(i - j) + (i == j ? kUnlike : 0.0);
    }
    const Eigen::LDLT<Eigen::MatrixXd> factors(values);
    const Eigen::VectorXd b = factors.solve(Eigen::VectorXd::Ones(n));
    for (int part = 0; part < kParts; ++part) {
      const int before = n / 2 - 1;
      const double at = before + static_cast<double>(part) / kParts;
      Eigen::VectorXd truth(n);
      for (int i = 0; i < n; ++i) truth(i) = likeness(i - at);
      const Eigen::VectorXd a = factors.solve(truth);
      const Eigen::VectorXd best = a + (1.0 - a.sum()) / b.sum() * b;
      for (int i = 0; i < n; ++i) w[kind][part][i] = static_cast<float>(best(i));
    }
  }
}

const Kriging kKriging;

}  // namespace bolo::motion

#include "src/deblur/lasso.hpp"

#include <algorithm>
#include <array>
#include <cmath>

namespace bolo::deblur {
namespace {

constexpr int kFirstSweeps = 8;
constexpr int kMaxSweeps = 1 << 17;
constexpr double kRidge = 1e-9;      // relative: keeps the start defined where frames are lost
constexpr double kRounding = 1e-10;  // relative to the largest |h|: what double precision leaves of the conditions

double soft(double x, double limit) { return x - std::clamp(x, -limit, limit); }

}  // namespace

void Lasso::set_gram(const Gram& gram) noexcept {
  gram_ = gram;
  start_ = Gram::Identity(gram.rows(), gram.cols());
  Gram regular = gram;
  regular.diagonal().array() += kRidge * (gram.diagonal().maxCoeff() + 1e-300);
  Eigen::LLT<Eigen::Ref<Gram>> factors(regular);
  factors.solveInPlace(start_);
}

bool Lasso::solve(const Coefficients& h, double lambda, Coefficients& d) const noexcept {
  d.noalias() = start_.lazyProduct(h);
  int sweeps = 0;
  for (int until = kFirstSweeps; until <= kMaxSweeps; until *= 2) {
    Coefficients gradient = h;
    gradient.noalias() -= gram_.lazyProduct(d);
    for (; sweeps < until; ++sweeps) sweep(lambda, d, gradient);
    if (polish(h, lambda, d)) return true;
  }
  return false;
}

void Lasso::sweep(double lambda, Coefficients& d, Coefficients& gradient) const noexcept {
  for (Eigen::Index i = 0; i < d.size(); ++i) {
    const double q = gram_(i, i);
    const double next = q > 0.0 ? soft(gradient(i) + q * d(i), lambda) / q : 0.0;
    if (next == d(i)) continue;
    gradient.noalias() -= (next - d(i)) * gram_.col(i);
    d(i) = next;
  }
}

bool Lasso::polish(const Coefficients& h, double lambda, Coefficients& d) const noexcept {
  std::array<Eigen::Index, kMaxColumns> support{};
  Eigen::Index count = 0;
  for (Eigen::Index i = 0; i < d.size(); ++i) {
    if (d(i) != 0.0) support[static_cast<std::size_t>(count++)] = i;
  }
  const auto at = [&](Eigen::Index i) { return support[static_cast<std::size_t>(i)]; };
  Gram part(count, count);
  Coefficients values(count);
  for (Eigen::Index i = 0; i < count; ++i) {
    values(i) = h(at(i)) - std::copysign(lambda, d(at(i)));
    for (Eigen::Index k = 0; k < count; ++k) part(i, k) = gram_(at(i), at(k));
  }
  Eigen::LLT<Eigen::Ref<Gram>> factors(part);
  if (count > 0 && factors.info() != Eigen::Success) return false;
  if (count > 0) factors.solveInPlace(values);
  Coefficients polished = Coefficients::Zero(d.size());
  for (Eigen::Index i = 0; i < count; ++i) {
    if (values(i) * d(at(i)) < 0.0 && lambda > 0.0) return false;
    polished(at(i)) = values(i);
  }
  Coefficients gradient = h;
  gradient.noalias() -= gram_.lazyProduct(polished);
  const double limit = lambda + kRounding * (h.cwiseAbs().maxCoeff() + lambda);
  if (!(gradient.cwiseAbs().maxCoeff() <= limit)) return false;
  d = polished;
  return true;
}

Optimality check(const Eigen::MatrixXd& z, const Eigen::VectorXd& y, const Eigen::VectorXd& d, double lambda) {
  const Eigen::VectorXd residual = y - z * d;
  const Eigen::VectorXd gradient = z.transpose() * residual;
  Optimality result;
  for (Eigen::Index i = 0; i < d.size(); ++i) {
    const double excess = d(i) == 0.0 ? std::max(0.0, std::abs(gradient(i)) - lambda)
                                      : std::abs(gradient(i) - std::copysign(lambda, d(i)));
    result.violation = std::max(result.violation, excess);
  }
  const double largest = gradient.size() > 0 ? gradient.cwiseAbs().maxCoeff() : 0.0;
  const Eigen::VectorXd dual = residual * (largest > lambda ? lambda / largest : 1.0);
  const double primal_value = 0.5 * residual.squaredNorm() + lambda * d.lpNorm<1>();
  result.gap = primal_value - (0.5 * y.squaredNorm() - 0.5 * (y - dual).squaredNorm());
  return result;
}

}  // namespace bolo::deblur

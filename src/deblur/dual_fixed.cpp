// The sweeps in int16.
//
// t_i is stored times right_i, by which it moves jumps, so that jumps are sums and differences of t; the jump at the
// window's beginning is stored divided by p. All values are in units of lambda: the bounds of t are constants of the
// plan, whatever the samples, and so is the largest value of
//   a jump                 -t_i of the wavelets that begin or end there, 2 t_i of the one with its middle there,
//   jumps' effect on t_i   their sum, or that of the outer ones less the middle, times pull_i,
//   t_i before clipping    this, keep_i t_i, and c_i:
// all but c_i are sums of t, whose largest value is the sum of its factors times the bounds. c_i alone has no bound of
// its own. It saturates, as does the sum with it, without effect: t_i is at its bound whenever one of them saturates.
// The unit is as small as these largest values allow.
#include <algorithm>
#include <cmath>

#include "src/deblur/dual_plan.hpp"

namespace bolo::deblur {
namespace {

constexpr double kLargest = 32700.0;        // the rest of int16 is for rounding
constexpr double kRoundingOfT = 0.55;       // rms, units: of c_i and two or three products
constexpr double kMostRounding_k = 3.0e-3;  // rms in the estimate, K: less than 5 mK with the sweeps' own error

std::int16_t fixed(double value) { return static_cast<std::int16_t>(std::lround(32768.0 * value)); }

using Form = std::array<double, kMaxDualBins>;  // factor of each t in a sum

// The largest value of any quantity, in units of a lambda_half of 1.
double largest(const DualPlan& plan, const Form& bound) noexcept {
  std::array<Form, kMaxDualBins + 1> jump{};
  const auto bins = static_cast<std::size_t>(plan.bins);
  const auto half_of = [](std::size_t i) { return i & (~i + 1); };
  const auto end_of = [&](std::size_t i) { return i == 0 ? bins : i + half_of(i); };
  for (std::size_t i = 0; i < bins; ++i) {
    jump[i - half_of(i)][i] -= 1.0;
    jump[end_of(i)][i] += i == 0 ? 1.0 : -1.0;
    if (half_of(i) > 1) jump[i][i] += 2.0;
  }
  const auto most_of = [&](double a, const Form& x, double b, const Form& y, double c, const Form& z) {
    double sum = 0.0;
    for (std::size_t i = 0; i < bins; ++i) sum += bound[i] * std::abs(a * x[i] + b * y[i] + c * z[i]);
    return sum;
  };
  double most = 0.0;
  for (std::size_t i = 0; i < bins; ++i) {
    const Form& begin = jump[i - half_of(i)];
    const Form& middle = jump[i];
    const Form& end = jump[end_of(i)];
    const double left = (i & (i - 1)) == 0 ? 1.0 / static_cast<double>(plan.inverse_p) : 1.0;
    const double right = i == 0 ? -1.0 : 1.0;
    const double kept = half_of(i) > 1 ? 1.0 : 0.0;
    const double ends = most_of(left, begin, right, end, -2.0 * kept, middle);
    const double pull = static_cast<double>(plan.row[i].right) * ends;
    most = std::max({most, most_of(1.0, begin, 0.0, middle, 0.0, end), most_of(0.0, begin, 0.0, middle, 1.0, end),
                     most_of(left, begin, (1.0 - kept) * right, end, -kept, middle),
                     kept * most_of(0.0, begin, -1.0, middle, 1.0, end),
                     pull + (1.0 + std::abs(static_cast<double>(plan.row[i].keep))) * bound[i], 2.0 * bound[i]});
  }
  return most;
}

// Rms effect of t's rounding on the last bin, in units. Every t moves the last term, the window's end jump, by as much.
double rounding(const DualPlan& plan) noexcept {
  const Estimate e = fixed_estimate(plan, {plan.bins - 1, plan.bins - 1});
  const double jump = std::abs(static_cast<double>(e.term[e.terms - 1].weight));
  double squares = 0.0;
  for (std::size_t k = 0; k + 1 < e.terms; ++k) {
    squares += std::pow(std::abs(static_cast<double>(e.term[k].weight)) + jump, 2);
  }
  return kRoundingOfT * std::sqrt(squares);
}

}  // namespace

Estimate fixed_estimate(const DualPlan& plan, const Published& bins) noexcept {
  Estimate e = dual_estimate(plan, bins);
  for (std::size_t k = 0; k < e.terms; ++k) {
    const std::size_t row = e.term[k].row;
    if (row < static_cast<std::size_t>(plan.bins)) e.term[k].weight /= plan.row[row].right;
    if (row == static_cast<std::size_t>(plan.bins)) e.term[k].weight /= plan.inverse_p;
  }
  return e;
}

void fix(DualPlan& plan, double lambda_k) noexcept {
  Form bound{};
  for (int i = 0; i < plan.bins; ++i) {
    const auto k = static_cast<std::size_t>(i);
    const int level = static_cast<int>(std::lround(std::log2(support_of(i, plan.bins)))) - 1;
    bound[k] = static_cast<double>(plan.bound[bound_of(i, level)]) * static_cast<double>(plan.row[k].right);
  }
  const double unit = largest(plan, bound) / kLargest;
  plan.fixed.unit = 0.0F;
  if (rounding(plan) * unit * lambda_k > kMostRounding_k) return;
  plan.fixed.unit = static_cast<float>(unit);
  plan.fixed.begin = fixed(1.0 / static_cast<double>(plan.inverse_p));
  for (std::size_t i = 0; i < static_cast<std::size_t>(plan.bins); ++i) {
    plan.fixed.row[i] = {fixed(static_cast<double>(plan.row[i].keep)), fixed(static_cast<double>(plan.row[i].right)),
                         static_cast<std::int16_t>(bound[i] / unit)};
  }
}

}  // namespace bolo::deblur

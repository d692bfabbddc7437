#include "src/deblur/admm_plan.hpp"

#include <cmath>

namespace bolo::deblur {
namespace {

// Index of the coefficient in the matrices' order: coarse to fine, each level from the window's begin.
std::size_t ordered(int i, int bins) {
  const int support = support_of(i, bins);
  return static_cast<std::size_t>(i == 0 ? 0 : bins / support + i / support);
}

}  // namespace

void prepare(AdmmPlan& plan, const Grid& grid, const Tuning& tuning, const Pattern& pattern) noexcept {
  prepare(plan.dense, grid, tuning, pattern);
  plan.start = make_dual_plan(grid, tuning.start);
  if (dual_bridges(pattern)) prepare(plan.start, grid, pattern);
  const double p = -std::expm1(-grid.ratio);
  for (int i = 0; i < grid.bins; ++i) {
    const double support = support_of(i, grid.bins);
    const DualCoefficients& row = plan.start.row[static_cast<std::size_t>(i)];
    plan.keep[static_cast<std::size_t>(i)] =
        static_cast<float>(static_cast<double>(row.keep) - 1.0 + support * row.gain / tuning.rho);
  }
  for (std::size_t level = 0; level < plan.threshold.size(); ++level) {
    plan.threshold[level] = static_cast<float>(p * grid.lambda_scale * std::sqrt(std::exp2(level + 1)) / tuning.rho);
  }
}

Estimate admm_estimate(const AdmmPlan& plan, const Published& published) noexcept {
  const DensePlan& dense = plan.dense;
  Estimate e;
  std::array<float, kMaxDualBins> basis{};
  for (std::size_t k = 0; k < static_cast<std::size_t>(dense.bins); ++k) {
    basis[k] = published.weight_before * dense.basis[static_cast<std::size_t>(published.before)][k] +
               published.weight_after * dense.basis[static_cast<std::size_t>(published.after)][k];
  }
  const auto of = [&](const std::array<float, kMaxDenseBins>& row) {
    float sum = 0.0F;
    for (std::size_t k = 0; k < static_cast<std::size_t>(dense.bins); ++k) sum += basis[k] * row[k];
    return sum;
  };
  e.mean = 1.0F;
  for (std::size_t i = 0; i < static_cast<std::size_t>(dense.samples); ++i) {
    const float weight = of(dense.data[i]);
    e.sample[static_cast<std::size_t>(dense.slot[i])] = weight;
    e.mean -= weight;
  }
  for (int i = 0; i < dense.bins; ++i) {
    const auto support = static_cast<float>(support_of(i, dense.bins));
    e.coefficient[static_cast<std::size_t>(i)] =
        plan.start.inverse_p / std::sqrt(support) * of(dense.feedback[ordered(i, dense.bins)]);
  }
  return e;
}

}  // namespace bolo::deblur

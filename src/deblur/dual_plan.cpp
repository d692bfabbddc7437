#include "src/deblur/dual_plan.hpp"

#include <bit>
#include <cmath>

namespace bolo::deblur {
namespace {

// Q_ii: a wavelet's squared jumps are 1 + 4 + 1; the one at the begin of the window counts 1 - a.
double curvature_of(int i, int bins, double decay) {
  const double c = decay / ((1.0 - decay) * (1.0 - decay));
  const int support = i == 0 ? bins : 2 * (i & -i);
  const double middle = i == 0 ? 0.0 : 4.0;
  const bool first = i == 0 || i - (i & -i) == 0;
  return 1.0 + c / support * (middle + 1.0 + (first ? 1.0 - decay : 1.0));
}

}  // namespace

bool dual_applies(const Grid& grid) { return grid.parts == 1 && grid.frames_per_bin == 1 && grid.bins <= kMaxDualBins; }

DualPlan make_dual_plan(const Grid& grid, double omega, int sweeps, int near_sweeps) {
  const double a = std::exp(-grid.ratio);
  const double p = -std::expm1(-grid.ratio);
  DualPlan plan;
  plan.bins = grid.bins;
  plan.sweeps = sweeps;
  plan.near_sweeps = near_sweeps;
  plan.lambda = static_cast<float>(grid.lambda / grid.lambda_scale);
  plan.inverse_gain = static_cast<float>(a / p);
  plan.inverse_count = 1.0F / static_cast<float>(grid.bins + 1);
  plan.begin_jump = static_cast<float>(p);
  plan.curvature = static_cast<float>(a / (p * p));
  for (std::size_t i = 0; i < plan.limit.size(); ++i) {
    plan.limit[i] = static_cast<float>(grid.lambda_scale / std::sqrt(std::exp2(i + 1)));
  }
  for (int i = 0; i < plan.bins; ++i) {
    const double support = i == 0 ? plan.bins : 2 * (i & -i);
    const double step = omega / curvature_of(i, plan.bins, a);
    DualCoefficients& row = plan.row[static_cast<std::size_t>(i)];
    row.gain = static_cast<float>(step / support);
    row.keep = static_cast<float>(1.0 - step);
    row.bend = static_cast<float>(step * a / (p * p) / support);
  }
  return plan;
}

void visit_order(int bins, std::array<int, kMaxDualBins>& order) {
  std::size_t count = 0;
  order[count++] = 0;
  const auto visit_tree = [&](int begin, int span, int group) {
    for (int width = span; width > span / group; width /= 2) {
      for (int at = begin; at < begin + span; at += width) order[count++] = at + width / 2;
    }
  };
  int group = std::countr_zero(static_cast<unsigned>(bins)) % 2 == 1 ? 2 : 4;
  for (int span = bins; span > 1; span /= group, group = 4) {
    if (span < bins) group = 4;
    for (int begin = 0; begin < bins; begin += 2 * span) visit_tree(begin, span, group);
    for (int begin = span; begin < bins; begin += 2 * span) visit_tree(begin, span, group);
  }
}

}  // namespace bolo::deblur

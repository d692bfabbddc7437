#include "src/deblur/interior_plan.hpp"

#include <cmath>

namespace bolo::deblur {
namespace {

// Found by search (tests/deblur: inputs): for samples that jump between the ends of the range fewer steps leave more
// than 50 mK, for all others nine are enough; more gain nothing in single precision.
constexpr int kSteps = 11;

// Weight of a lost row in place of its sample's: a leaf coupled only through others would be lost in single precision.
// It delays the leaf after it by a^2 of this, and vanishes as the steps become small.
constexpr float kHold = 10.0F;

}  // namespace

InteriorPlan make_interior_plan(const Settings& settings, const Grid& grid) {
  const WithinFrame within = within_frame(settings);
  const double a = std::exp(-grid.ratio);
  const double p = -std::expm1(-grid.ratio);
  const double gain = -within.effect / p;  // |g|
  InteriorPlan plan;
  plan.bins = grid.frames;
  plan.parts = grid.parts;
  plan.steps = settings.iterations > 0 ? settings.iterations : kSteps;
  const double scale = std::sqrt(std::exp2(settings.levels) / grid.frames);
  plan.lambda = static_cast<float>(grid.lambda / grid.lambda_scale);
  plan.lambda_scale = static_cast<float>(scale);
  plan.bound = static_cast<float>(1.0 / (gain * scale));
  plan.overshoot = static_cast<float>(within.value / gain);
  plan.decay = static_cast<float>(a);
  plan.curvature = static_cast<float>(1.0 / (p * p));
  plan.inverse_gain = static_cast<float>(a / p);
  for (int i = 0; i < plan.bins; ++i) {
    plan.row[static_cast<std::size_t>(i)].limit = std::sqrt(static_cast<float>(i == 0 ? plan.bins : 2 * (i & -i)));
  }
  return plan;
}

void prepare(InteriorPlan& plan, const Grid& grid, const Pattern& pattern) noexcept {
  plan.inverse_count = 1.0F / static_cast<float>(pattern.count);
  fill_lost(grid, pattern, plan.value);
  plan.border = -1;
  int carries = 0;
  float before = 0.0F;  // weight of the row before
  for (int i = 0; i < plan.bins; ++i) {
    const bool known = i >= pattern.first && pattern.received[static_cast<std::size_t>(i + 1)];
    InteriorRow& row = plan.row[static_cast<std::size_t>(i)];
    row.weight = known ? 1.0F : 0.0F;
    row.diagonal = plan.curvature * (row.weight + plan.decay * plan.decay * before);
    if (!known) row.diagonal += kHold * plan.curvature;
    row.carry = !known && i >= pattern.first && i + 1 < plan.bins ? plan.decay : 0.0F;
    before = row.weight;
    if (row.carry != 0.0F) plan.border = ++carries == 1 ? i : -1;
  }
}

}  // namespace bolo::deblur

#include "src/deblur/inverse_plan.hpp"

#include <cmath>

namespace bolo::deblur {

InversePlan make_inverse_plan(const Grid& grid, const Pattern& pattern) noexcept {
  const int before = pattern.before(pattern.target);
  const int after = pattern.after(pattern.target);
  const double share = before >= 0 && after >= 0 ? 0.5 : 1.0;
  InversePlan plan{pattern.target, pattern.target, pattern.target, 0.0F, 0.0F};
  if (before >= 0) {
    plan.before = before;  // x - y_t = a^g / (1 - a^g) (y_t - y_before)
    plan.back = static_cast<float>(share / std::expm1(grid.ratio * (pattern.target - before)));
  }
  if (after >= 0) {
    plan.after = after;  // x - y_t = 1 / (1 - a^g) (y_after - y_t)
    plan.ahead = static_cast<float>(-share / std::expm1(-grid.ratio * (after - pattern.target)));
  }
  return plan;
}

}  // namespace bolo::deblur

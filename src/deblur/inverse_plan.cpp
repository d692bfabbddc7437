#include "src/deblur/inverse_plan.hpp"

#include <algorithm>
#include <cmath>

namespace bolo::deblur {
namespace {

void add_tap(InversePlan& plan, int slot, double weight) noexcept {
  if (slot == plan.target) return;
  for (int i = 0; i < plan.taps; ++i) {
    InversePlan::Tap& tap = plan.tap[static_cast<std::size_t>(i)];
    if (tap.slot != slot) continue;
    tap.weight += static_cast<float>(weight);
    return;
  }
  plan.tap[static_cast<std::size_t>(plan.taps++)] = {slot, static_cast<float>(weight)};
}

// weight times the input of the interval from slot `interval` to the next: y_1 + (y_1 - y_0) / (a^-g - 1).
void add_interval(InversePlan& plan, const Grid& grid, const Pattern& pattern, int interval, double weight) noexcept {
  int begin = pattern.before(interval + 1);
  int end = pattern.after(interval);
  if (begin < 0) begin = end, end = pattern.after(begin);  // before the first sample: the first gap
  if (end < 0) end = begin, begin = pattern.before(end);   // after the last sample: the last gap
  if (begin < 0 || end < 0 || weight == 0.0) return;       // a lone sample
  const double back = weight / std::expm1(grid.ratio * (end - begin));
  add_tap(plan, begin, -back);
  add_tap(plan, end, weight + back);
}

}  // namespace

InversePlan make_inverse_plan(const Grid& grid, const Pattern& pattern, double delay) noexcept {
  const double last = pattern.slots - 2;
  const double q = pattern.target - delay - 0.5;
  const double whole = std::floor(q);
  const auto interval = [&](double at) { return static_cast<int>(std::clamp(at, 0.0, last)); };
  InversePlan plan;
  plan.target = pattern.target;
  add_interval(plan, grid, pattern, interval(whole), 1.0 - (q - whole));
  add_interval(plan, grid, pattern, interval(whole + 1.0), q - whole);
  return plan;
}

}  // namespace bolo::deblur

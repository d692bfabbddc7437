#include "src/deblur/dual_plan.hpp"

#include <algorithm>
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

// Two workers keep 200 frames/s with a gap in every window; more searches would come closer to the optimum.
constexpr int kSearches = 10;
constexpr int kSweepsAfterSearch = 2;

// How much bin `bin` counts in coefficient i, without normalisation: 1, -1 or 0.
double sign_of(int i, int bin) {
  if (i == 0) return 1.0;
  const int half = i & -i;
  if (bin < i - half || bin >= i + half) return 0.0;
  return bin < i ? 1.0 : -1.0;
}

Gap gap_of(const DualPlan& plan, const Grid& grid, const Pattern& pattern) noexcept {
  Gap gap;
  if (pattern.count != pattern.slots - 1 || pattern.first != 0) return gap;
  int lost = 0;
  while (pattern.received[static_cast<std::size_t>(lost)]) ++lost;
  if (lost == pattern.slots - 1) return gap;
  const double a = std::exp(-grid.ratio);
  gap.searches = kSearches;
  gap.bin = lost - 1;
  gap.inverse_p = static_cast<float>(1.0 / (1.0 - a));
  for (int i = 0; i < plan.bins; ++i) {
    const double part = sign_of(i, gap.bin) - a * sign_of(i, gap.bin + 1);
    if (sign_of(i, gap.bin) == 0.0 && sign_of(i, gap.bin + 1) == 0.0) continue;
    const auto at = static_cast<std::size_t>(gap.count++);
    gap.index[at] = i;
    gap.weight[at] =
        static_cast<float>(static_cast<double>(plan.row[static_cast<std::size_t>(i)].gain) * part / (1.0 - a));
  }
  return gap;
}

}  // namespace

bool dual_applies(const Grid& grid) { return grid.parts == 1 && grid.frames_per_bin == 1 && grid.bins <= kMaxDualBins; }

DualPlan make_dual_plan(const Grid& grid, const DualTuning& tuning) {
  const double a = std::exp(-grid.ratio);
  const double p = -std::expm1(-grid.ratio);
  DualPlan plan;
  plan.bins = grid.bins;
  plan.sweeps = tuning.sweeps;
  plan.near_sweeps = plan.near_sweeps_whole = tuning.near_sweeps;
  plan.lambda = static_cast<float>(grid.lambda / grid.lambda_scale);
  plan.inverse_gain = static_cast<float>(a / p);
  plan.begin_jump = static_cast<float>(p);
  plan.curvature = static_cast<float>(a / (p * p));
  for (std::size_t i = 0; i < plan.limit.size(); ++i) {
    plan.limit[i] = static_cast<float>(grid.lambda_scale / std::sqrt(std::exp2(i + 1)));
  }
  for (int i = 0; i < plan.bins; ++i) {
    const double support = i == 0 ? plan.bins : 2 * (i & -i);
    const double step = tuning.omega / curvature_of(i, plan.bins, a);
    DualCoefficients& row = plan.row[static_cast<std::size_t>(i)];
    row.gain = static_cast<float>(step / support);
    row.keep = static_cast<float>(1.0 - step);
    row.bend = static_cast<float>(step * a / (p * p) / support);
  }
  return plan;
}

void fill_lost(const Grid& grid, const Pattern& pattern, std::array<SlotValue, kMaxSlots>& values) noexcept {
  for (int slot = 0; slot < pattern.slots; ++slot) {
    SlotValue& value = values[static_cast<std::size_t>(slot)];
    const int before = pattern.before(slot);
    const int after = pattern.after(slot);
    if (pattern.received[static_cast<std::size_t>(slot)]) {
      value = {slot, slot, 0.0F};
    } else if (before < 0 || after < 0) {
      value = {std::max(before, after), std::max(before, after), 0.0F};
    } else {
      const double part = std::expm1(-grid.ratio * (slot - before)) / std::expm1(-grid.ratio * (after - before));
      value = {before, after, static_cast<float>(part)};
    }
  }
}

void prepare(DualPlan& plan, const Grid& grid, const Pattern& pattern) noexcept {
  plan.inverse_count = 1.0F / static_cast<float>(pattern.count);
  fill_lost(grid, pattern, plan.value);
  plan.gap = gap_of(plan, grid, pattern);
  plan.near_sweeps = plan.near_sweeps_whole + (plan.gap.searches > 0 ? kSweepsAfterSearch : 0);
}

}  // namespace bolo::deblur

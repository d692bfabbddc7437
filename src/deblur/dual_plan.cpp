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

// How much bin `bin` counts in coefficient i, without normalisation: 1, -1 or 0.
double sign_of(int i, int bin, int bins) {
  if (bin >= bins) return 0.0;
  if (i == 0) return 1.0;
  const int half = i & -i;
  if (bin < i - half || bin >= i + half) return 0.0;
  return bin < i ? 1.0 : -1.0;
}

LostSample lost_sample(const DualPlan& plan, const Grid& grid, const SlotValue& value, int slot) noexcept {
  LostSample lost;
  lost.slot = slot;
  lost.after = value.after;
  lost.weight = value.weight;
  const double a = std::exp(-grid.ratio);
  // In one pair of bins only their wavelet would be left to follow, which no bound holds.
  const bool pair = slot % 2 == 1 || slot == plan.bins;
  for (const bool around : {false, true}) {
    for (int i = 0; i < plan.bins; ++i) {
      const double near = sign_of(i, slot - 1, plan.bins);
      const double far = sign_of(i, slot, plan.bins);
      if ((near == 0.0 && far == 0.0) || around != (near == far)) continue;
      const double move = near - a * far;
      const double share = move * plan.row[static_cast<std::size_t>(i)].gain;
      const int level = static_cast<int>(std::lround(std::log2(i == 0 ? plan.bins : 2 * (i & -i)))) - 1;
      LostSample::Part& part = lost.part[lost.parts++];
      part.row = i;
      part.bound = bound_of(i, level);
      part.move = static_cast<float>(move);
      part.share = static_cast<float>(share);
      part.slope = static_cast<float>(share * move);
      part.inverse = static_cast<float>(1.0 / move);
    }
    if (!around || pair) lost.led = lost.parts;
  }
  return lost;
}

bool lost_neighbours(const Pattern& pattern) noexcept {
  for (int slot = 1; slot < pattern.slots; ++slot) {
    const auto i = static_cast<std::size_t>(slot);
    if (!pattern.received[i - 1] && !pattern.received[i]) return true;
  }
  return false;
}

}  // namespace

bool dual_bridges(const Pattern& pattern) { return pattern.first == 0 && pattern.slots - pattern.count <= kMostLost; }

bool dual_applies(const Grid& grid) { return grid.parts == 1 && grid.frames_per_bin == 1 && grid.bins <= kMaxDualBins; }

DualPlan make_dual_plan(const Grid& grid, const DualTuning& tuning) {
  const double a = std::exp(-grid.ratio);
  const double p = -std::expm1(-grid.ratio);
  DualPlan plan;
  plan.bins = grid.bins;
  plan.sweeps = tuning.sweeps;
  plan.near_sweeps = tuning.near_sweeps;
  plan.lambda = static_cast<float>(grid.lambda / grid.lambda_scale);
  plan.decay = static_cast<float>(a);
  plan.inverse_p = static_cast<float>(1.0 / p);
  plan.mean_to_sum = static_cast<float>(p * grid.bins);
  for (int i = 0; i < plan.bins; ++i) {
    const int half = i & -i;
    const double support = i == 0 ? plan.bins : 2 * half;
    const double step = tuning.omega / curvature_of(i, plan.bins, a);
    DualCoefficients& row = plan.row[static_cast<std::size_t>(i)];
    row.gain = step / support;
    const double bend = row.gain * a / (p * p);
    row.keep = static_cast<float>(1.0 - step - (half == 1 ? 4.0 * bend : 0.0));
    row.left = static_cast<float>(i == half ? p * bend : bend);
    row.right = static_cast<float>(bend);
    const int level = static_cast<int>(std::lround(std::log2(support))) - 1;
    plan.bound[bound_of(i, level)] = static_cast<float>(p * grid.lambda_scale / std::sqrt(support) / row.gain);
  }
  return plan;
}

Estimate dual_estimate(const DualPlan& plan, const Published& bins) noexcept {
  Estimate e;
  const auto add_bin = [&](int bin, double weight) {
    const double scaled = weight * static_cast<double>(plan.inverse_p);
    e.sample[static_cast<std::size_t>(bin + 1)] += static_cast<float>(scaled);
    e.sample[static_cast<std::size_t>(bin)] -= static_cast<float>(scaled * static_cast<double>(plan.decay));
    for (int half = plan.bins; half > 0; half /= 2) {
      const int i = half == plan.bins ? 0 : (bin & ~(2 * half - 1)) + half;
      const DualCoefficients& row = plan.row[static_cast<std::size_t>(i)];
      const bool right = i != 0 && (bin & half) != 0;
      // Between the bins of a pair the jump is 2 row.right t_i.
      const double v = row.gain + (half == 1 ? 2.0 * static_cast<double>(row.right) : 0.0);
      e.term[e.terms++] = {static_cast<std::size_t>(i), static_cast<float>(right ? scaled * v : -scaled * v)};
    }
    const bool second = bin % 2 == 1;
    e.term[e.terms++] = {static_cast<std::size_t>(plan.bins + (bin + 1) / 2),
                         static_cast<float>(second ? -scaled : scaled)};
  };
  if (bins.before == bins.after) {
    add_bin(bins.before, static_cast<double>(bins.weight_before) + static_cast<double>(bins.weight_after));
  } else {
    add_bin(bins.before, static_cast<double>(bins.weight_before));
    add_bin(bins.after, static_cast<double>(bins.weight_after));
  }
  return e;
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
  std::array<SlotValue, kMaxSlots> values;
  fill_lost(grid, pattern, values);
  plan.inverse_count = 1.0F / static_cast<float>(pattern.count);
  plan.lost = 0;
  for (int slot = 0; slot < pattern.slots; ++slot) {
    const SlotValue& value = values[static_cast<std::size_t>(slot)];
    plan.stand_in[static_cast<std::size_t>(slot)] = value.before;
    if (pattern.received[static_cast<std::size_t>(slot)]) continue;
    plan.gap[plan.lost++] = lost_sample(plan, grid, value, slot);
  }
  if (plan.lost == 0) return;
  plan.sweeps += plan.near_sweeps + 2 * static_cast<int>(plan.lost) - 1;  // they wait for each other
  if (lost_neighbours(pattern)) plan.sweeps *= 2;                         // most of all beside each other
  plan.near_sweeps = 0;
}

}  // namespace bolo::deblur

#include "src/deblur/banded_plan.hpp"

#include <cmath>

namespace bolo::deblur {
namespace {

// support of the coefficient at index i of the in-place transform
int support(int i, int bins) { return i == 0 ? bins : 2 * (i & -i); }

void prepare_samples(BandedPlan& plan, const Grid& grid, const Tuning& tuning, const Pattern& pattern) noexcept {
  const double p = -std::expm1(-grid.ratio / grid.parts);
  plan.samples = 0;
  int last = pattern.first;
  for (int slot = 0; slot < pattern.slots; ++slot) {
    if (!pattern.received[static_cast<std::size_t>(slot)]) continue;
    SampleCoefficients& sample = plan.sample[static_cast<std::size_t>(plan.samples++)];
    sample.slot = slot;
    sample.row = slot == pattern.first ? -1 : grid.row_after(slot) - 1;
    sample.first_row = grid.row_after(last);
    sample.weight = static_cast<float>(p / tuning.rho);
    sample.decay = static_cast<float>(std::exp(-grid.ratio * (slot - pattern.first)));
    sample.inverse_gain = slot == last ? 1.0F : static_cast<float>(-1.0 / std::expm1(-grid.ratio * (slot - last)));
    last = slot;
  }
  plan.inverse_count = 1.0F / static_cast<float>(plan.samples);
}

// Rows before the reference have no sample and rows after it do not depend on them: there x = v.
void factor(BandedPlan& plan, const Grid& grid, const Tuning& tuning, const Pattern& pattern) noexcept {
  const double decay = grid.bin_decay();
  const double p = -std::expm1(-grid.ratio / grid.parts);
  const int start = grid.row_after(pattern.first);
  double pivot = 0.0;
  double lower_times_decay = 0.0;
  for (int j = 0; j < plan.bins; ++j) {
    RowCoefficients& row = plan.row[static_cast<std::size_t>(j)];
    const double next = j + 1 == plan.bins || j + 1 == start ? 0.0 : decay;
    const int slot = (j + 1) / grid.parts;
    const bool measured = j >= start && (j + 1) % grid.parts == 0 && pattern.received[static_cast<std::size_t>(slot)];
    pivot = 1.0 + next * next + (measured ? p * p / tuning.rho : 0.0) - lower_times_decay;
    row.pivot = static_cast<float>(1.0 / pivot);
    row.next_decay = static_cast<float>(next);
    if (j + 1 < plan.bins) plan.row[static_cast<std::size_t>(j) + 1].lower = static_cast<float>(-next / pivot);
    lower_times_decay = next * next / pivot;
  }
}

}  // namespace

BandedPlan make_banded_plan(const Grid& grid, const Tuning& tuning) {
  BandedPlan plan;
  plan.bins = grid.bins;
  plan.iterations = tuning.iterations;
  plan.alpha = static_cast<float>(tuning.alpha);
  plan.rest = static_cast<float>(1.0 - tuning.alpha);
  plan.row.resize(static_cast<std::size_t>(grid.bins));
  for (int i = 0; i < grid.bins; ++i) {
    const double width = support(i, grid.bins);
    RowCoefficients& row = plan.row[static_cast<std::size_t>(i)];
    row.threshold = static_cast<float>(grid.lambda / tuning.rho / std::sqrt(width));
    row.step = static_cast<float>(tuning.alpha / width);
  }
  return plan;
}

void prepare(BandedPlan& plan, const Grid& grid, const Tuning& tuning, const Pattern& pattern) noexcept {
  const Published bins = published_bins(grid, pattern.slots, pattern.target);
  plan.before = bins.before;
  plan.after = bins.after;
  prepare_samples(plan, grid, tuning, pattern);
  factor(plan, grid, tuning, pattern);
}

}  // namespace bolo::deblur

#include "src/deblur/banded_plan.hpp"

#include <algorithm>
#include <cmath>

namespace bolo::deblur {
namespace {

// support of the coefficient at index i of the in-place transform
int support(int i, int bins) { return i == 0 ? bins : 2 * (i & -i); }

void prepare_coefficients(BandedPlan& plan, const Grid& grid, const Tuning& tuning) noexcept {
  for (int i = 0; i < plan.bins; ++i) {
    const double width = support(i, plan.bins);
    RowCoefficients& row = plan.row[static_cast<std::size_t>(i)];
    row.threshold = static_cast<float>(grid.lambda_scale / tuning.rho / std::sqrt(width));
    row.step = static_cast<float>(tuning.alpha / width);
  }
}

// The diagonal of p^2/rho M + B^T B, in row.own for now, and the decays. Rows before the reference have no sample and
// rows after it do not depend on them: there x = v.
void assemble(BandedPlan& plan, const Grid& grid, const Tuning& tuning, const Pattern& pattern) noexcept {
  const double p = -std::expm1(-grid.ratio);
  const int start = pattern.first;
  const double a = std::exp(-grid.ratio);
  for (int j = 0; j < plan.bins; ++j) {
    const double next = j + 1 == plan.bins || j + 1 == start ? 0.0 : a;
    const bool measured = j >= start && pattern.received[static_cast<std::size_t>(j + 1)];
    plan.diagonal[static_cast<std::size_t>(j)] = 1.0 + next * next + (measured ? p * p / tuning.rho : 0.0);
    plan.row[static_cast<std::size_t>(j)].next_decay = static_cast<float>(next);
  }
}

// Eliminates row j from its inner neighbour. The entry between rows j and j + 1 is -next_decay of row j.
void eliminate(BandedPlan& plan, int j, int inner) noexcept {
  const auto outer_row = static_cast<std::size_t>(j);
  const auto inner_row = static_cast<std::size_t>(inner);
  const double entry = -static_cast<double>(plan.row[std::min(outer_row, inner_row)].next_decay);
  plan.diagonal[inner_row] -= entry * entry / plan.diagonal[outer_row];
  plan.row[outer_row].eliminate = static_cast<float>(entry);
  plan.row[outer_row].substitute = static_cast<float>(entry / plan.diagonal[outer_row]);
}

void factor(BandedPlan& plan) noexcept {
  const int middle = plan.bins / 2;
  for (int j = 0; j < middle; ++j) eliminate(plan, j, j + 1);
  for (int j = plan.bins - 1; j > middle; --j) eliminate(plan, j, j - 1);
  for (int j = 0; j < plan.bins; ++j) {
    RowCoefficients& row = plan.row[static_cast<std::size_t>(j)];
    const double pivot = plan.diagonal[static_cast<std::size_t>(j)];
    const int inner = j < middle ? j + 1 : j - 1;
    row.own = static_cast<float>(1.0 / pivot);
    row.next = static_cast<float>(row.next_decay / pivot);
    if (j == middle) continue;
    row.eliminate = static_cast<float>(row.eliminate / plan.diagonal[static_cast<std::size_t>(inner)]);
  }
}

void prepare_samples(BandedPlan& plan, const Grid& grid, const Tuning& tuning, const Pattern& pattern) noexcept {
  const double p = -std::expm1(-grid.ratio);
  for (RowCoefficients& row : plan.row) row.weight = 0.0F;
  for (int slot = pattern.first + 1; slot < pattern.slots; ++slot) {
    if (!pattern.received[static_cast<std::size_t>(slot)]) continue;
    const auto j = static_cast<std::size_t>(slot - 1);
    plan.row[j].weight = static_cast<float>(p / tuning.rho / plan.diagonal[j]);
    plan.row[j].decay = static_cast<float>(std::exp(-grid.ratio * (slot - pattern.first)));
  }
  plan.reference = pattern.first;
  plan.inverse_count = 1.0F / static_cast<float>(pattern.count);
}

}  // namespace

BandedPlan make_banded_plan(const Grid& grid) {
  BandedPlan plan;
  plan.bins = grid.bins;
  plan.row.resize(static_cast<std::size_t>(grid.bins));
  plan.diagonal.resize(static_cast<std::size_t>(grid.bins));
  return plan;
}

void prepare(BandedPlan& plan, const Grid& grid, const Tuning& tuning, const Pattern& pattern) noexcept {
  plan.iterations = tuning.iterations;
  plan.alpha = static_cast<float>(tuning.alpha);
  plan.lambda = static_cast<float>(grid.lambda / grid.lambda_scale);
  plan.scaled = static_cast<float>(1.0 / tuning.rho);
  prepare_coefficients(plan, grid, tuning);
  assemble(plan, grid, tuning, pattern);
  factor(plan);
  prepare_samples(plan, grid, tuning, pattern);
  plan.start = make_dual_plan(grid, tuning.start);
  prepare(plan.start, grid, pattern);
}

}  // namespace bolo::deblur

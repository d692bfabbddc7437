#include "src/deblur/admm_plan.hpp"

#include <cmath>

namespace bolo::deblur {
namespace {

// On the stack: no allocation when the pattern of lost frames changes on the hot path.
using Square = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::ColMajor, kMaxDenseBins, kMaxDenseBins>;
using Rows = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::ColMajor, kMaxSlots, kMaxDenseBins>;

// A ridge this small moves the start by less than single precision, and keeps it defined when samples are few.
constexpr double kRidge = 1e-9;

double haar_at(int coefficient, int bin, int bins) {
  if (coefficient == 0) return 1.0 / std::sqrt(bins);
  int support = bins;
  int first = 1;
  for (; first * 2 <= coefficient; first *= 2) support /= 2;
  const int offset = bin - (coefficient - first) * support;
  if (offset < 0 || offset >= support) return 0.0;
  return (offset < support / 2 ? 1.0 : -1.0) / std::sqrt(support);
}

// S: the response of sample `slot` to each coefficient; rows of the reference and of lost frames are zero.
Rows response(const Grid& grid, const Pattern& pattern) noexcept {
  Rows s = Rows::Zero(pattern.slots, grid.bins);
  const double p = -std::expm1(-grid.ratio);
  for (int slot = pattern.first + 1; slot < pattern.slots; ++slot) {
    if (!pattern.received[static_cast<std::size_t>(slot)]) continue;
    for (int frame = pattern.first; frame < slot; ++frame) {
      const double g = p * std::exp(-grid.ratio * (slot - 1 - frame));
      for (int k = 0; k < grid.bins; ++k) s(slot, k) += g * haar_at(k, frame / grid.frames_per_bin, grid.bins);
    }
  }
  return s;
}

void store_columns(const Rows& map, const Grid& grid, const Pattern& pattern, DensePlan& plan,
                   std::array<std::array<float, kMaxDenseBins>, kMaxSlots>& to) noexcept {
  for (int k = 0; k < grid.bins; ++k) {
    double reference = 0.0;  // Y = y - y_0 exp(-t / tau) folded into the reference's weight
    for (int i = 1; i < plan.samples; ++i) {
      const int slot = plan.slot[static_cast<std::size_t>(i)];
      to[static_cast<std::size_t>(i)][static_cast<std::size_t>(k)] = static_cast<float>(map(slot, k));
      reference -= map(slot, k) * std::exp(-grid.ratio * (slot - pattern.first));
    }
    to[0][static_cast<std::size_t>(k)] = static_cast<float>(reference);
  }
}

// S (S^T S + ridge I)^-1, one column a coefficient.
Rows regularised(const Rows& s, const Square& inverse) noexcept {
  Rows map(s.rows(), s.cols());
  map.noalias() = s.lazyProduct(inverse);
  return map;
}

Square inverse_of(const Rows& s, double ridge) noexcept {
  Square gram(s.cols(), s.cols());
  gram.noalias() = s.transpose().lazyProduct(s);
  gram.diagonal().array() += ridge;
  Square inverse = Square::Identity(s.cols(), s.cols());
  Eigen::LLT<Eigen::Ref<Square>> factors(gram);
  factors.solveInPlace(inverse);
  return inverse;
}

// Index of the coefficient in the matrices' order: coarse to fine, each level from the window's beginning.
std::size_t ordered(int i, int bins) {
  const int support = support_of(i, bins);
  return static_cast<std::size_t>(i == 0 ? 0 : bins / support + i / support);
}

}  // namespace

void prepare(DensePlan& plan, const Grid& grid, const Tuning& tuning, const Pattern& pattern) noexcept {
  plan.bins = grid.bins;
  plan.iterations = tuning.iterations;
  plan.alpha = static_cast<float>(tuning.alpha);
  plan.lambda = static_cast<float>(grid.lambda / grid.lambda_scale);
  plan.threshold = static_cast<float>(grid.lambda_scale / tuning.rho);
  plan.samples = 0;
  for (int s = 0; s < pattern.slots; ++s) {
    if (pattern.received[static_cast<std::size_t>(s)]) plan.slot[static_cast<std::size_t>(plan.samples++)] = s;
  }
  plan.inverse_count = 1.0F / static_cast<float>(plan.samples);
  const Rows s = response(grid, pattern);
  const Square inverse = inverse_of(s, tuning.rho);
  store_columns(regularised(s, inverse), grid, pattern, plan, plan.data);
  store_columns(regularised(s, inverse_of(s, kRidge)), grid, pattern, plan, plan.start);
  for (int i = 0; i < grid.bins; ++i) {
    for (int k = 0; k < grid.bins; ++k) {
      const auto column = static_cast<std::size_t>(k);
      plan.feedback[column][static_cast<std::size_t>(i)] = static_cast<float>(tuning.rho * inverse(i, k));
      plan.basis[column][static_cast<std::size_t>(i)] = static_cast<float>(haar_at(i, k, grid.bins));
    }
  }
}

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

#include "tests/deblur/reference.hpp"

#include <Eigen/Dense>

#include "src/deblur/dual_plan.hpp"
#include "src/model/bolometer.hpp"

namespace bolo::deblur {
namespace {

using Eigen::MatrixXd;
using Eigen::VectorXd;

// M G: rows are slots; the reference's and those of lost frames are zero.
MatrixXd response(const Grid& grid, const Pattern& pattern) {
  MatrixXd g = MatrixXd::Zero(pattern.slots, grid.bins);
  const double part = grid.ratio / grid.parts;
  for (int slot = pattern.first + 1; slot < pattern.slots; ++slot) {
    if (!pattern.received[static_cast<std::size_t>(slot)]) continue;
    for (int step = pattern.first * grid.parts; step < slot * grid.parts; ++step) {
      g(slot, step / grid.frames_per_bin) -= std::expm1(-part) * std::exp(-part * (slot * grid.parts - 1 - step));
    }
  }
  return g;
}

// M Y of the samples less their mean.
VectorXd data(const Grid& grid, const Pattern& pattern, std::span<const double> y, double mean) {
  VectorXd result = VectorXd::Zero(pattern.slots);
  for (int slot = pattern.first + 1; slot < pattern.slots; ++slot) {
    if (!pattern.received[static_cast<std::size_t>(slot)]) continue;
    const double reference = y[static_cast<std::size_t>(pattern.first)] - mean;
    result(slot) =
        y[static_cast<std::size_t>(slot)] - mean - reference * std::exp(-grid.ratio * (slot - pattern.first));
  }
  return result;
}

double mean_of(const Pattern& pattern, std::span<const double> y) {
  double sum = 0.0;
  for (int slot = 0; slot < pattern.slots; ++slot) {
    if (pattern.received[static_cast<std::size_t>(slot)]) sum += y[static_cast<std::size_t>(slot)];
  }
  return sum / pattern.count;
}

VectorXd without_mean(std::span<const double> y, double mean) {
  VectorXd result(static_cast<Eigen::Index>(y.size()));
  for (std::size_t slot = 0; slot < y.size(); ++slot) result(static_cast<Eigen::Index>(slot)) = y[slot] - mean;
  return result;
}

// The wavelets in the order of the in-place butterflies.
MatrixXd in_place_haar(int bins) {
  MatrixXd h = MatrixXd::Constant(1, bins, 1.0 / std::sqrt(bins)).replicate(bins, 1);
  for (int i = 1; i < bins; ++i) {
    const int half = i & -i;
    h.row(i).setZero();
    h.row(i).segment(i - half, half).setConstant(1.0 / std::sqrt(2.0 * half));
    h.row(i).segment(i, half).setConstant(-1.0 / std::sqrt(2.0 * half));
  }
  return h;
}

// A coefficient and the bins of the tree that it is visited with.
struct Visit {
  int coefficient = 0;
  int begin = 0;
  int end = 0;
};

// The order in which a sweep visits the coefficients: coarse to fine, in trees of two levels, every other tree first. A
// near sweep leaves out trees without a published bin. Fills order[0, bins).
void visit_order(int bins, std::array<Visit, kMaxDualBins>& order) {
  std::size_t count = 0;
  order[count++] = {0, 0, bins};
  const auto visit_tree = [&](int begin, int span, int group) {
    for (int width = span; width > span / group; width /= 2) {
      for (int at = begin; at < begin + span; at += width) order[count++] = {at + width / 2, begin, begin + span};
    }
  };
  int group = std::countr_zero(static_cast<unsigned>(bins)) % 2 == 1 ? 2 : 4;
  for (int span = bins; span > 1; span /= group, group = 4) {
    if (span < bins) group = 4;
    for (int begin = 0; begin < bins; begin += 2 * span) visit_tree(begin, span, group);
    for (int begin = span; begin < bins; begin += 2 * span) visit_tree(begin, span, group);
  }
}

struct DualPoint {
  VectorXd t;  // in bins: H^T t
  VectorXd x;
};

DualPoint descend(const Grid& grid, const DualTuning& tuning, const Published& published, const VectorXd& y) {
  const int bins = grid.bins;
  const double a = std::exp(-grid.ratio);
  MatrixXd inverse = MatrixXd::Identity(bins, bins);  // G^-1
  inverse.diagonal(-1).setConstant(-a);
  inverse /= 1.0 - a;
  const MatrixXd h = in_place_haar(bins);
  const MatrixXd q = h * inverse * inverse.transpose() * h.transpose();
  VectorXd d = h * (y.tail(bins) - a * y.head(bins)) / (1.0 - a);
  VectorXd t = VectorXd::Zero(bins);
  std::array<Visit, kMaxDualBins> order;
  visit_order(bins, order);
  for (int k = 0; k < tuning.sweeps + tuning.near_sweeps; ++k) {
    for (int n = 0; n < bins; ++n) {
      const Visit& visit = order[static_cast<std::size_t>(n)];
      const bool near = visit.end > published.before && visit.begin <= published.after;
      if (k >= tuning.sweeps && !near) continue;
      const int i = visit.coefficient;
      const double next = std::clamp(t(i) + tuning.omega * d(i) / q(i, i), -grid.lambda, grid.lambda);
      d -= (next - t(i)) * q.col(i);
      t(i) = next;
    }
  }
  return {h.transpose() * t, h.transpose() * d};
}

double estimate(const Published& bins, const VectorXd& x) {
  return static_cast<double>(bins.weight_before) * x(bins.before) +
         static_cast<double>(bins.weight_after) * x(bins.after);
}

}  // namespace

double reference_dual(const Grid& grid, const DualTuning& tuning, const Pattern& pattern, std::span<const double> y) {
  const double mean = mean_of(pattern, y);
  const Published bins = published_bins(grid, pattern.slots, pattern.target);
  return mean + estimate(bins, descend(grid, tuning, bins, without_mean(y, mean)).x);
}

double reference_admm(const Grid& grid, const Tuning& tuning, const Pattern& pattern, std::span<const double> y) {
  const MatrixXd h = model::haar_matrix(grid.bins);
  const MatrixXd g = response(grid, pattern);
  const double mean = mean_of(pattern, y);
  const VectorXd gty = g.transpose() * data(grid, pattern, y, mean);
  const MatrixXd identity = MatrixXd::Identity(grid.bins, grid.bins);
  const MatrixXd gram = g.transpose() * g;
  const Eigen::LLT<MatrixXd> factors(gram + tuning.rho * identity);
  const double limit = grid.lambda / tuning.rho;

  VectorXd x = Eigen::LLT<MatrixXd>(gram + 1e-9 * identity).solve(gty);
  VectorXd w = h * x;
  const Published bins = published_bins(grid, pattern.slots, pattern.target);
  if (dual_applies(grid) && tuning.iterations == 1) {
    const DualPoint start = descend(grid, tuning.start, bins, without_mean(y, mean));
    w = h * (start.x + start.t / tuning.rho);
  }
  for (int k = 0; k < tuning.iterations; ++k) {
    const VectorXd u = w.cwiseMax(-limit).cwiseMin(limit);
    const VectorXd z = w - u;
    x = factors.solve(gty + tuning.rho * h.transpose() * (z - u));
    w = tuning.alpha * (h * x) + (1.0 - tuning.alpha) * z + u;
  }
  return mean + estimate(bins, x);
}

}  // namespace bolo::deblur

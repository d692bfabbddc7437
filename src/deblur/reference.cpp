#include "src/deblur/reference.hpp"

#include <Eigen/Dense>
#include <cmath>

#include "bolo/model/haar.hpp"

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

// Where the iteration begins: the input that is constant between samples and explains them.
VectorXd inverse_filter(const Grid& grid, const Pattern& pattern, std::span<const double> y, double mean) {
  VectorXd x = VectorXd::Zero(grid.bins);
  int last = pattern.first;
  double input = 0.0;
  const auto fill = [&](int to_slot) {
    for (int bin = last == pattern.first ? 0 : last * grid.parts; bin < to_slot * grid.parts; ++bin) x(bin) = input;
  };
  for (int slot = pattern.first + 1; slot < pattern.slots; ++slot) {
    if (!pattern.received[static_cast<std::size_t>(slot)]) continue;
    const double decay = std::exp(-grid.ratio * (slot - last));
    const double before = y[static_cast<std::size_t>(last)] - mean;
    input = (y[static_cast<std::size_t>(slot)] - mean - decay * before) / (1.0 - decay);
    fill(slot);
    last = slot;
  }
  fill(grid.frames);
  return x;
}

}  // namespace

double reference_admm(const Grid& grid, const Tuning& tuning, const Pattern& pattern, std::span<const double> y) {
  const MatrixXd h = model::haar_matrix(grid.bins);
  const MatrixXd g = response(grid, pattern);
  const double mean = mean_of(pattern, y);
  const VectorXd gty = g.transpose() * data(grid, pattern, y, mean);
  const MatrixXd identity = MatrixXd::Identity(grid.bins, grid.bins);
  const MatrixXd gram = g.transpose() * g;
  const Eigen::LLT<MatrixXd> factors(gram + tuning.rho * identity);
  const double limit = grid.lambda / tuning.rho;

  VectorXd x = grid.frames_per_bin == 1 ? inverse_filter(grid, pattern, y, mean)
                                        : VectorXd(Eigen::LLT<MatrixXd>(gram + 1e-9 * identity).solve(gty));
  VectorXd w = h * x;
  for (int k = 0; k < tuning.iterations; ++k) {
    const VectorXd u = w.cwiseMax(-limit).cwiseMin(limit);
    const VectorXd z = w - u;
    x = factors.solve(gty + tuning.rho * h.transpose() * (z - u));
    w = tuning.alpha * (h * x) + (1.0 - tuning.alpha) * z + u;
  }
  const Published bins = published_bins(grid, pattern.slots, pattern.target);
  return mean + 0.5 * (x(bins.before) + x(bins.after));
}

}  // namespace bolo::deblur

#include "src/deblur/tuning.hpp"

#include <algorithm>
#include <cmath>

namespace bolo::deblur {
namespace {

constexpr double kAlpha = 1.7;
constexpr double kReferenceLambda = 0.5;  // half-square units, K: the authors' setting
constexpr double kIterationsThere = 16.0;
constexpr double kIterationsPerDecade = 5.0;
constexpr double kFewest = 6.0;
constexpr double kMost = 40.0;

}  // namespace

// Found by search over rho 0.02..1, alpha 1..1.9 on the golden windows (tests/deblur/golden: street, steps, 300 K
// pulses and 20 K white noise; 8, 16 and 32 frames; T / tau 0.45 and 0.9), for the fewest iterations after which the
// error stays below 5 mK rms and 50 mK at most. The best rho is p^2 everywhere, p = 1 - exp(-T / tau): G's columns have
// the scale p. alpha between 1.6 and 1.8 makes no difference of more than one iteration. lambda / rho is how far a step
// may move a coefficient that is too far from zero, so the way from the inverse filter to the optimum is shorter the
// smaller lambda is: scenes want 10 iterations at 0.5, 6 at 0.05, 3 at 0.005, white noise of 20 K up to half as many
// again. Bins shorter than a frame leave directions that no sample sees, where only lambda pulls: four times as many.
Tuning tune(const Grid& grid, double kelvin_per_value) {
  const double p = -std::expm1(-grid.ratio / grid.parts);
  const double lambda_half = grid.lambda * std::sqrt(grid.bins / 128.0) * kelvin_per_value;
  const double decades = std::log10(std::max(lambda_half, 1e-6) / kReferenceLambda);
  const double wanted = std::clamp(kIterationsThere + kIterationsPerDecade * decades, kFewest, kMost);
  return {p * p, kAlpha, static_cast<int>(std::lround(grid.parts > 1 ? 4.0 * wanted : wanted))};
}

DualTuning tune_dual(const Grid& grid, double kelvin_per_value) {
  const double lambda_half = grid.lambda / grid.lambda_scale * kelvin_per_value;
  const double decades = std::log10(std::max(lambda_half, 1e-6) / kReferenceLambda);
  const int sweeps = static_cast<int>(std::ceil(5.0 + decades));
  const int near = sweeps >= 4 ? 2 : sweeps / 3;
  return {1.1, sweeps - near, near};
}

}  // namespace bolo::deblur

#include "src/deblur/tuning.hpp"

#include <algorithm>
#include <array>
#include <cmath>

namespace bolo::deblur {
namespace {

// Found by search on steps, 20 K noise, 300 K pulses, defects, pans, waves, texture, saturated and constant values
// (tests/deblur: inputs), for 5 mK rms and at most 50 mK from the exact optimum in the last two bins, in the worst.
//  - Sweeps of the dual: 1.1 is the best over-relaxation almost everywhere, 1.0 and 1.2 cost up to one sweep in five.
//    8 to 64 frames need as many. The last two need to reach only the published bins.
//  - ADMM from there: its rate is best with rho = p^2, alpha = 1.6 (p = 1 - exp(-T / tau), so that p^2 is near the
//    smallest eigenvalue of G^T G); one iteration removes up to two thirds of the sweeps' error, and 0.4 to 1.4 mK rms
//    remain on a street. Without such a start, where bins are longer than frames, it needs kNeeded.
//  - Lost frames that the sweeps do not support leave directions that only lambda determines; such windows need
//    many iterations.
constexpr std::array kRatios = {0.05, 0.1, 0.2, 0.4545, 1.0, 2.0};              // T / tau
constexpr std::array kLambdas = {0.0005, 0.005, 0.05, 0.5, 5.0, 50.0};          // K, half-square, 2^7 coefficients
using Table = std::array<std::array<double, kLambdas.size()>, kRatios.size()>;  // iterations
constexpr Table kSweeps = {{{4, 7, 11, 18, 27, 31},
                            {3, 5, 10, 13, 19, 21},
                            {2, 3, 7, 9, 13, 15},
                            {1, 2, 3, 6, 7, 9},
                            {1, 1, 2, 3, 5, 6},
                            {1, 1, 2, 3, 4, 5}}};
constexpr Table kNeeded = {{{17, 64, 81, 110, 92, 67},
                            {9, 17, 48, 76, 57, 46},
                            {4, 10, 21, 32, 39, 39},
                            {2, 4, 7, 14, 28, 38},
                            {1, 3, 4, 8, 18, 23},
                            {1, 2, 2, 5, 7, 8}}};

// Position of `value` between entries of an ascending axis, on a logarithmic scale; clamped to the axis.
template <std::size_t kSize>
double place(const std::array<double, kSize>& axis, double value) {
  for (std::size_t i = 0; i + 1 < kSize; ++i) {
    if (value > axis[i + 1]) continue;
    return static_cast<double>(i) + std::max(0.0, std::log(value / axis[i]) / std::log(axis[i + 1] / axis[i]));
  }
  return static_cast<double>(kSize - 1);
}

// Bilinear in the logarithms of ratio, lambda and count.
double needed(const Table& table, double ratio, double lambda) {
  const double row = place(kRatios, ratio);
  const double column = place(kLambdas, lambda);
  const auto i = std::min(static_cast<std::size_t>(row), kRatios.size() - 2);
  const auto k = std::min(static_cast<std::size_t>(column), kLambdas.size() - 2);
  const double down = row - static_cast<double>(i);
  const double right = column - static_cast<double>(k);
  const auto between = [&](const auto& line) {
    return (1.0 - right) * std::log(line[k]) + right * std::log(line[k + 1]);
  };
  return std::exp((1.0 - down) * between(table[i]) + down * between(table[i + 1]));
}

}  // namespace

DualTuning tune_dual(const Grid& grid, double lambda_half_k) {
  const double sweeps = std::ceil(needed(kSweeps, grid.ratio, std::max(lambda_half_k, 1e-6)) - 0.05);
  DualTuning tuning;
  const bool near = grid.bins > 8;  // all of so few bins are near
  tuning.near_sweeps = !near ? 0 : sweeps > 3.0 ? 2 : sweeps > 2.0 ? 1 : 0;
  tuning.sweeps = static_cast<int>(sweeps) - tuning.near_sweeps;
  return tuning;
}

Tuning tune(const Grid& grid, double lambda_half_k, bool bridged) {
  const double p = -std::expm1(-grid.ratio);
  const int cold = static_cast<int>(std::ceil(1.1 * needed(kNeeded, grid.ratio, std::max(lambda_half_k, 1e-6))));
  Tuning tuning;
  tuning.rho = p * p * grid.frames_per_bin;
  tuning.start = tune_dual(grid, lambda_half_k);
  tuning.iterations = !bridged ? 2 * cold : grid.frames_per_bin == 1 ? 1 : cold;
  return tuning;
}

}  // namespace bolo::deblur

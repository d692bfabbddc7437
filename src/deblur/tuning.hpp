// How fast ADMM gets there: penalty, over-relaxation and the number of iterations, from lambda and T / tau.
#pragma once

#include "src/deblur/grid.hpp"

namespace bolo::deblur {

struct Tuning {
  double rho = 0.1;    // penalty
  double alpha = 1.7;  // over-relaxation
  int iterations = 8;
};

// `kelvin_per_value`: what one unit of the values is worth. Thread: setup.
Tuning tune(const Grid& grid, double kelvin_per_value);

struct DualTuning {
  double omega = 1.1;  // over-relaxation
  int sweeps = 3;
  int near_sweeps = 2;  // at most sweeps
};

// As tune(), for coordinate descent on the dual. Thread: setup.
DualTuning tune_dual(const Grid& grid, double kelvin_per_value);

}  // namespace bolo::deblur

// How fast ADMM and the dual get there: penalty, over-relaxation and the number of iterations, from lambda and T / tau.
#pragma once

#include "src/deblur/grid.hpp"

namespace bolo::deblur {

// Coordinate descent on the dual.
struct DualTuning {
  double omega = 1.1;  // over-relaxation
  int sweeps = 3;
  int near_sweeps = 2;  // after those, over what reaches into the published bins
};

struct Tuning {
  double rho = 0.1;    // penalty
  double alpha = 1.6;  // over-relaxation
  int iterations = 2;
  DualTuning start;  // sweeps on the dual that come before; where it does not apply they are not used
};

// `lambda_half_k`: in K. Thread: setup.
DualTuning tune_dual(const Grid& grid, double lambda_half_k);

// How many frames of a window are lost. The start finds the value of one between others (dual_plan.hpp).
enum class Lost { kNone, kOne, kMore };

// Thread: setup.
Tuning tune(const Grid& grid, double lambda_half_k, Lost lost);

}  // namespace bolo::deblur

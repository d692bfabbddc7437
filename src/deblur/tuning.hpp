// Convergence of ADMM and the dual: penalty, over-relaxation and the number of iterations, from lambda and T / tau.
#pragma once

#include "src/deblur/grid.hpp"

namespace bolo::deblur {

// Coordinate descent on the dual.
struct DualTuning {
  double omega = 1.1;  // over-relaxation
  int sweeps = 3;
  int near_sweeps = 2;  // further ones, over what affects the published bins
};

struct Tuning {
  double rho = 0.1;    // penalty
  double alpha = 1.6;  // over-relaxation
  int iterations = 1;
  DualTuning start;  // sweeps on the dual, before a single iteration
};

// `lambda_half_k`: in K. Thread: setup.
DualTuning tune_dual(const Grid& grid, double lambda_half_k);

// `bridged`: no frame is lost, or only frames that the sweeps support. Thread: setup.
Tuning tune(const Grid& grid, double lambda_half_k, bool bridged);

}  // namespace bolo::deblur

// The solvers behind Solver::create.
#pragma once

#include <memory>

#include "bolo/deblur/solver.hpp"

namespace bolo::deblur {

// What every solver needs to know of its stream.
struct StreamTask {
  Settings settings;
  StreamFormat input;
  PixelType output = PixelType::kUint16;

  // What one unit of the values is worth, K; camera counts are taken for 10 mK, as in the A655sc's linear modes.
  double kelvin_per_value() const;
  // lambda / (2 kappa) in the units of the values.
  double lambda_half() const;
};

// Settings and formats were checked. Thread: setup.
std::unique_ptr<Solver> make_admm_solver(const StreamTask& task);
std::unique_ptr<Solver> make_exact_solver(const StreamTask& task);
std::unique_ptr<Solver> make_inverse_solver(const StreamTask& task);

}  // namespace bolo::deblur

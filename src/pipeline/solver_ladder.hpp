// The solver that the settings ask for, and the cheaper ones that stand in for it.
#pragma once

#include <array>
#include <memory>

#include "src/deblur/solver.hpp"
#include "src/pipeline/effort.hpp"

namespace bolo::pipeline {

class SolverLadder {
 public:
  // As Solver::create(). Without `degrade` there is only the full one. Thread: setup.
  static Result<SolverLadder> create(const deblur::Settings& settings, const StreamFormat& input, PixelType output,
                                     double row_delay_s, bool degrade);

  const deblur::Solver& full() const noexcept { return *solvers_.front(); }
  // Not for kRaw, which solves nothing. Thread: pipeline.
  deblur::Solver& at(Effort effort) noexcept { return *solvers_[static_cast<std::size_t>(effort)]; }

 private:
  std::array<std::unique_ptr<deblur::Solver>, kEfforts - 1> solvers_;
};

}  // namespace bolo::pipeline

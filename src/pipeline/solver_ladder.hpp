// The solver that the settings ask for, and the cheaper ones that stand in for it; a description of the settings.
#pragma once

#include <array>
#include <memory>
#include <string>
#include <string_view>

#include "src/deblur/solver.hpp"
#include "src/pipeline/quality_level.hpp"

namespace bolo::pipeline {

// Measured cost of the solvers on this processor.
struct Pace {
  QualityLevel least = QualityLevel::kFull;  // the first of which a frame takes no longer than a period
  double full_s = 0.0;                       // a frame of the full one
};

class SolverLadder {
 public:
  // As Solver::create(). Without `degrade` there is only the full one. Thread: setup.
  static Result<SolverLadder> create(const deblur::Settings& settings, const StreamFormat& input, PixelType output,
                                     double row_delay_s, bool degrade);

  // Solves a frame of noise, or as much of it as 50 ms allow. Solvers that were not made are skipped. Their memory then
  // is of invented noise: frames need a ladder of their own. Thread: setup.
  Pace measure(const deblur::Settings& settings, const StreamFormat& input, PixelType output, int workers);

  const deblur::Solver& full() const noexcept { return *solvers_.front(); }
  // Not for kRaw, which solves nothing. Thread: pipeline.
  deblur::Solver& at(QualityLevel level) noexcept { return *solvers_[static_cast<std::size_t>(level)]; }

 private:
  std::array<std::unique_ptr<deblur::Solver>, kQualityLevels - 1> solvers_;
};

// Method, iterations, lambda, kappa and instruction set: "admm, 8 iterations, lambda 0.002 K, kappa 0.1, AVX3". Short
// enough for the 64 bytes it has in shared memory, whatever the values. Thread: setup.
std::string describe_solver(const deblur::Settings& settings, Unit unit, std::string_view isa);

}  // namespace bolo::pipeline

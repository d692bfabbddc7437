// The configured solver and its cheaper substitutes; a description of the settings.
#pragma once

#include <array>
#include <memory>
#include <string>
#include <string_view>

#include "src/deblur/solver.hpp"
#include "src/pipeline/quality_level.hpp"

namespace bolo::pipeline {

struct Pace {
  QualityLevel least = QualityLevel::kFull;  // first level whose frames take no longer than a period
  double full_s = 0.0;                       // time per frame at full effort
};

class SolverLadder {
 public:
  // As Solver::create(). Without `degrade`, only the configured solver. Thread: setup.
  static Result<SolverLadder> create(const deblur::Settings& settings, const StreamFormat& input, PixelType output,
                                     double row_delay_s, bool degrade);

  // Solves a synthetic frame, or as much of it as 50 ms allow. Skips solvers that were not created. The solvers' memory
  // then holds invented noise: frames need a ladder of their own. Thread: setup.
  Pace measure(const deblur::Settings& settings, const StreamFormat& input, PixelType output, int workers);

  const deblur::Solver& full() const noexcept { return *solvers_.front(); }
  // Not for kRaw, which solves nothing. Thread: pipeline.
  deblur::Solver& at(QualityLevel level) noexcept { return *solvers_[static_cast<std::size_t>(level)]; }

 private:
  std::array<std::unique_ptr<deblur::Solver>, kQualityLevels - 1> solvers_;
};

// Method, iterations, lambda, kappa and instruction set: "admm, 8 iterations, lambda 0.002 K, kappa 0.1, AVX3". Always
// fits the 64 bytes it has in shared memory. Thread: setup.
std::string describe_solver(const deblur::Settings& settings, Unit unit, std::string_view isa);

}  // namespace bolo::pipeline

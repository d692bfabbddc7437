#include "src/pipeline/solver_ladder.hpp"

#include <utility>

namespace bolo::pipeline {
namespace {

// For comparison, a frame of 640x120 with one thread (tools/bench): admm 1.55 ms, with automatic lambda 3.4, mmae 1.25;
// reduced 0.45; inverse 0.02. motion makes mmae's estimate too.
deblur::Settings cheaper(deblur::Settings settings, Effort effort) {
  settings.auto_lambda = false;
  if (effort == Effort::kInverse) {
    settings.method = deblur::Method::kInverse;
  } else if (settings.method == deblur::Method::kMotion) {
    settings.method = deblur::Method::kMmae;
  } else if (settings.method != deblur::Method::kInverse) {
    settings.method = deblur::Method::kDual;
    settings.iterations = 1;
  }
  return settings;
}

}  // namespace

Result<SolverLadder> SolverLadder::create(const deblur::Settings& settings, const StreamFormat& input, PixelType output,
                                          double row_delay_s, bool degrade) {
  SolverLadder ladder;
  for (const Effort effort : {Effort::kFull, Effort::kReduced, Effort::kInverse}) {
    const bool full = effort == Effort::kFull;
    if (!full && !degrade) break;
    auto made = deblur::Solver::create(full ? settings : cheaper(settings, effort), input, output, row_delay_s);
    if (!made) return tl::unexpected<Error>(std::move(made.error()));
    ladder.solvers_[static_cast<std::size_t>(effort)] = std::move(*made);
  }
  return ladder;
}

}  // namespace bolo::pipeline

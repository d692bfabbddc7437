// The dual's method, and what stands in for it where the dual does not apply.
#include <algorithm>

#include "src/deblur/method.hpp"

namespace bolo::deblur {
namespace {

// ADMM solves the patterns of lost frames that the sweeps do not apply to, or, with three, leave something to do.
class DualMethod final : public PixelMethod {
 public:
  DualMethod(const StreamTask& task, const Grid& grid, const DualTuning& tuning)
      : grid_(grid),
        tuning_(tuning),
        lambda_k_(lambda_to_tune(task)),
        kernels_(best_kernels()),
        otherwise_(admm(task)) {}

  void prepare(const Pattern& pattern) noexcept override {
    applies_ = dual_bridges(pattern) && pattern.slots - pattern.count < kMostLost;
    if (!applies_) return otherwise_->prepare(pattern);
    plan_ = make_dual_plan(grid_, tuning_);
    deblur::prepare(plan_, grid_, pattern);
    if (plan_.lost == 0) fix(plan_, lambda_k_);
  }

  void run(const PixelRun& run) const noexcept override {
    if (applies_) return kernels_.dual(plan_, run);
    otherwise_->run(run);
  }

  int iterations() const noexcept override { return tuning_.sweeps + tuning_.near_sweeps; }
  std::string_view isa() const noexcept override { return kernels_.isa; }

 private:
  static std::unique_ptr<PixelMethod> admm(StreamTask task) {
    task.settings.iterations = 0;  // those that were asked for are sweeps
    return make_admm(task);
  }

  Grid grid_;
  DualTuning tuning_;
  double lambda_k_;
  DualPlan plan_;
  const Kernels& kernels_;
  std::unique_ptr<PixelMethod> otherwise_;
  bool applies_ = true;
};

}  // namespace

std::unique_ptr<PixelMethod> make_dual(const StreamTask& task) {
  const Grid grid = reduce(task.settings, task.lambda_half());
  if (!dual_applies(grid)) return make_admm(task);
  DualTuning tuning = tune_dual(grid, lambda_to_tune(task));
  if (task.settings.iterations > 0) {
    tuning.near_sweeps = std::min(tuning.near_sweeps, task.settings.iterations - 1);
    tuning.sweeps = task.settings.iterations - tuning.near_sweeps;
  }
  return std::make_unique<DualMethod>(task, grid, tuning);
}

}  // namespace bolo::deblur

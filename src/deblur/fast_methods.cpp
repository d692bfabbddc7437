// The methods that run on the vector kernels: ADMM, the interior point and the inverse filter.
#include <algorithm>

#include "src/deblur/interior_kernel.hpp"
#include "src/deblur/method.hpp"

namespace bolo::deblur {
namespace {

class AdmmMethod final : public PixelMethod {
 public:
  explicit AdmmMethod(const StreamTask& task)
      : grid_(reduce(task.settings, task.lambda_half())),
        whole_(tuning(task, Lost::kNone)),
        without_one_(tuning(task, Lost::kOne)),
        without_more_(tuning(task, Lost::kMore)),
        kernels_(best_kernels()) {
    if (grid_.frames_per_bin == 1) banded_ = make_banded_plan(grid_);
  }

  void prepare(const Pattern& pattern) noexcept override {
    const Tuning& tuned = tuning_for(pattern);
    if (grid_.frames_per_bin == 1) {
      deblur::prepare(banded_, grid_, tuned, pattern);
    } else {
      deblur::prepare(dense_, grid_, tuned, pattern);
    }
  }

  void run(const PixelRun& run) const noexcept override {
    if (grid_.frames_per_bin == 1) {
      kernels_.banded(banded_, run);
    } else {
      kernels_.dense(dense_, run);
    }
  }

  int iterations() const noexcept override { return whole_.iterations; }
  std::string_view isa() const noexcept override { return kernels_.isa; }

 private:
  const Tuning& tuning_for(const Pattern& pattern) const {
    if (pattern.count == pattern.slots) return whole_;
    const bool between = pattern.first == 0 && pattern.received[static_cast<std::size_t>(pattern.slots - 1)];
    return pattern.count == pattern.slots - 1 && between && dual_applies(grid_) ? without_one_ : without_more_;
  }

  Tuning tuning(const StreamTask& task, Lost lost) const {
    Tuning tuned = tune(grid_, lambda_to_tune(task), lost);
    if (task.settings.iterations > 0) tuned.iterations = task.settings.iterations;
    return tuned;
  }

  Grid grid_;
  Tuning whole_;
  Tuning without_one_;
  Tuning without_more_;
  const Kernels& kernels_;
  BandedPlan banded_;
  DensePlan dense_;
};

class InteriorMethod final : public PixelMethod {
 public:
  explicit InteriorMethod(const StreamTask& task)
      : grid_(reduce(task.settings, task.lambda_half())),
        plan_(make_interior_plan(task.settings, grid_)),
        kernel_(best_interior_kernel()) {}

  void prepare(const Pattern& pattern) noexcept override { deblur::prepare(plan_, grid_, pattern); }
  void run(const PixelRun& run) const noexcept override { kernel_.solve(plan_, run); }
  int iterations() const noexcept override { return plan_.steps; }
  std::string_view isa() const noexcept override { return kernel_.isa; }

 private:
  Grid grid_;
  InteriorPlan plan_;
  const InteriorKernel& kernel_;
};

class InverseMethod final : public PixelMethod {
 public:
  explicit InverseMethod(const StreamTask& task) : grid_(reduce(task.settings, 0.0)), kernels_(best_kernels()) {}

  void prepare(const Pattern& pattern) noexcept override {
    pattern_ = pattern;
    plan_ = make_inverse_plan(grid_, pattern);
  }

  void run(const PixelRun& run) const noexcept override {
    kernels_.inverse(run.delay == 0.0 ? plan_ : make_inverse_plan(grid_, pattern_, run.delay), run);
  }

  int iterations() const noexcept override { return 1; }
  std::string_view isa() const noexcept override { return kernels_.isa; }

 private:
  Grid grid_;
  const Kernels& kernels_;
  Pattern pattern_;
  InversePlan plan_;  // of a row without delay
};

}  // namespace

std::unique_ptr<PixelMethod> make_admm(const StreamTask& task) { return std::make_unique<AdmmMethod>(task); }
std::unique_ptr<PixelMethod> make_interior(const StreamTask& task) { return std::make_unique<InteriorMethod>(task); }
std::unique_ptr<PixelMethod> make_inverse(const StreamTask& task) { return std::make_unique<InverseMethod>(task); }

}  // namespace bolo::deblur

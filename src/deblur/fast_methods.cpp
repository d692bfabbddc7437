// The methods that run on the vector kernels: ADMM and the inverse filter.
#include <algorithm>

#include "src/deblur/method.hpp"

namespace bolo::deblur {
namespace {

class AdmmMethod final : public PixelMethod {
 public:
  explicit AdmmMethod(const StreamTask& task)
      : grid_(reduce(task.settings, task.lambda_half())),
        tuning_(tune(grid_, task.kelvin_per_value())),
        kernels_(best_kernels()) {
    if (task.settings.iterations > 0) tuning_.iterations = task.settings.iterations;
    if (grid_.frames_per_bin == 1) banded_ = make_banded_plan(grid_, tuning_);
  }

  void prepare(const Pattern& pattern) noexcept override {
    if (grid_.frames_per_bin == 1) {
      deblur::prepare(banded_, grid_, tuning_, pattern);
    } else {
      deblur::prepare(dense_, grid_, tuning_, pattern);
    }
  }

  void run(const PixelRun& run) const noexcept override {
    if (grid_.frames_per_bin == 1) {
      kernels_.banded(banded_, run);
    } else {
      kernels_.dense(dense_, run);
    }
  }

  int iterations() const noexcept override { return tuning_.iterations; }
  std::string_view isa() const noexcept override { return kernels_.isa; }

 private:
  Grid grid_;
  Tuning tuning_;
  const Kernels& kernels_;
  BandedPlan banded_;
  DensePlan dense_;
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

  SlotRange needed(double delay) const noexcept override {
    const InversePlan plan = delay == 0.0 ? plan_ : make_inverse_plan(grid_, pattern_, delay);
    SlotRange slots{plan.target, plan.target + 1};
    for (int i = 0; i < plan.taps; ++i) {
      const int slot = plan.tap[static_cast<std::size_t>(i)].slot;
      slots = {std::min(slots.first, slot), std::max(slots.end, slot + 1)};
    }
    return slots;
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
std::unique_ptr<PixelMethod> make_inverse(const StreamTask& task) { return std::make_unique<InverseMethod>(task); }

}  // namespace bolo::deblur

// The methods that run on the vector kernels: ADMM, dual and its fallback, interior point, inverse filter.
#include <algorithm>
#include <cmath>

#include "src/deblur/interior_plan.hpp"
#include "src/deblur/method.hpp"

namespace bolo::deblur {
namespace {

// One iteration, started from the dual's sweeps. For bins longer than a frame, more than three lost frames or more
// iterations: full matrices, started from least squares.
class AdmmMethod final : public PixelMethod {
 public:
  explicit AdmmMethod(const StreamTask& task)
      : grid_(reduce(task.settings, task.lambda_half())),
        asked_(task.settings.iterations),
        whole_(tuning(task, true)),
        without_(tuning(task, false)),
        kernels_(best_kernels()) {}

  void prepare(const Pattern& pattern) noexcept override {
    const bool whole = pattern.count == pattern.slots;
    started_ = dual_applies(grid_) && dual_bridges(pattern) && whole_.iterations == 1;
    deblur::prepare(plan_, grid_, whole || started_ ? whole_ : without_, pattern);
  }

  void run(const PixelRun& run) const noexcept override {
    if (started_) {
      kernels_.admm(plan_, run);
    } else {
      kernels_.dense(plan_.dense, run);
    }
  }

  int iterations() const noexcept override { return whole_.iterations; }
  std::string_view isa() const noexcept override { return kernels_.isa; }

 private:
  Tuning tuning(const StreamTask& task, bool bridged) const {
    Tuning tuned = tune(grid_, lambda_to_tune(task), bridged);
    if (asked_ > 0) tuned.iterations = asked_;
    return tuned;
  }

  Grid grid_;
  int asked_;
  Tuning whole_;
  Tuning without_;
  const Kernels& kernels_;
  AdmmPlan plan_;
  bool started_ = false;
};

// Falls back to ADMM for patterns of lost frames that the sweeps do not support, or, with three, do not finish.
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
    task.settings.iterations = 0;  // the number asked for is of sweeps
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

class InteriorMethod final : public PixelMethod {
 public:
  explicit InteriorMethod(const StreamTask& task)
      : grid_(reduce(task.settings, task.lambda_half())),
        plan_(make_interior_plan(task.settings, grid_)),
        kernels_(best_kernels()) {}

  void prepare(const Pattern& pattern) noexcept override { deblur::prepare(plan_, grid_, pattern); }
  void run(const PixelRun& run) const noexcept override { kernels_.interior(plan_, run); }
  int iterations() const noexcept override { return plan_.steps; }
  std::string_view isa() const noexcept override { return kernels_.isa; }

 private:
  Grid grid_;
  InteriorPlan plan_;
  const Kernels& kernels_;
};

void add_tap(InversePlan& plan, int slot, double weight) noexcept {
  if (slot == plan.target) return;
  for (int i = 0; i < plan.taps; ++i) {
    InversePlan::Tap& tap = plan.tap[static_cast<std::size_t>(i)];
    if (tap.slot != slot) continue;
    tap.weight += static_cast<float>(weight);
    return;
  }
  plan.tap[static_cast<std::size_t>(plan.taps++)] = {slot, static_cast<float>(weight)};
}

// weight times the input of the interval from slot `interval` to the next: y_1 + (y_1 - y_0) / (a^-g - 1).
void add_interval(InversePlan& plan, const Grid& grid, const Pattern& pattern, int interval, double weight) noexcept {
  int begin = pattern.before(interval + 1);
  int end = pattern.after(interval);
  if (begin < 0) begin = end, end = pattern.after(begin);  // before the first sample: the first gap
  if (end < 0) end = begin, begin = pattern.before(end);   // after the last sample: the last gap
  if (begin < 0 || end < 0 || weight == 0.0) return;       // a lone sample
  const double back = weight / std::expm1(grid.ratio * (end - begin));
  add_tap(plan, begin, -back);
  add_tap(plan, end, weight + back);
}

// The published value is linear between centres of frame intervals (grid.hpp), each with the input of the gap that
// contains it; intervals before the first or after the last sample take the nearest gap's. `delay`: the row's, periods.
InversePlan make_inverse_plan(const Grid& grid, const Pattern& pattern, double delay = 0.0) noexcept {
  const double last = pattern.slots - 2;
  const double q = pattern.target - delay - 0.5;
  const double whole = std::floor(q);
  const auto interval = [&](double at) { return static_cast<int>(std::clamp(at, 0.0, last)); };
  InversePlan plan;
  plan.target = pattern.target;
  add_interval(plan, grid, pattern, interval(whole), 1.0 - (q - whole));
  add_interval(plan, grid, pattern, interval(whole + 1.0), q - whole);
  return plan;
}

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

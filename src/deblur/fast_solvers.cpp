// The solvers that run on the vector kernels: ADMM and the inverse filter.
#include "src/deblur/kernels.hpp"
#include "src/deblur/solvers.hpp"

namespace bolo::deblur {
namespace {

PixelRun run_of(const StreamTask& task, const WindowView& window, RowRange rows, void* out) noexcept {
  const bool kelvin = task.output == PixelType::kFloat32 && task.input.scale.unit == Unit::kKelvin;
  const auto width = static_cast<std::size_t>(task.input.geometry.width);
  PixelRun run;
  run.planes = window.planes.data();
  run.input = task.input.type;
  run.output = task.output;
  run.scale = kelvin ? static_cast<float>(task.input.scale.scale) : 1.0F;
  run.offset = kelvin ? static_cast<float>(task.input.scale.offset) : 0.0F;
  run.begin = static_cast<std::size_t>(rows.begin) * width;
  run.end = static_cast<std::size_t>(rows.end) * width;
  run.out = out;
  return run;
}

class AdmmSolver final : public Solver {
 public:
  explicit AdmmSolver(const StreamTask& task)
      : task_(task),
        grid_(reduce(task.settings, task.lambda_half())),
        tuning_(tune(grid_, task.kelvin_per_value())),
        kernels_(best_kernels()) {
    if (task.settings.iterations > 0) tuning_.iterations = task.settings.iterations;
    if (grid_.frames_per_bin == 1) banded_ = make_banded_plan(grid_, tuning_);
  }

  void prepare(const WindowView& window) noexcept override {
    const Pattern pattern = pattern_of(window);
    if (pattern == pattern_) return;
    pattern_ = pattern;
    if (grid_.frames_per_bin == 1) {
      deblur::prepare(banded_, grid_, tuning_, pattern);
    } else {
      deblur::prepare(dense_, grid_, tuning_, pattern);
    }
  }

  void solve(const WindowView& window, RowRange rows, void* out) const noexcept override {
    const PixelRun run = run_of(task_, window, rows, out);
    if (grid_.frames_per_bin == 1) {
      kernels_.banded(banded_, run);
    } else {
      kernels_.dense(dense_, run);
    }
  }

  int iterations() const noexcept override { return tuning_.iterations; }
  std::string_view isa() const noexcept override { return kernels_.isa; }

 private:
  StreamTask task_;
  Grid grid_;
  Tuning tuning_;
  const Kernels& kernels_;
  Pattern pattern_;
  BandedPlan banded_;
  DensePlan dense_;
};

class InverseSolver final : public Solver {
 public:
  explicit InverseSolver(const StreamTask& task)
      : task_(task), grid_(reduce(task.settings, 0.0)), kernels_(best_kernels()) {}

  void prepare(const WindowView& window) noexcept override { plan_ = make_inverse_plan(grid_, pattern_of(window)); }

  void solve(const WindowView& window, RowRange rows, void* out) const noexcept override {
    kernels_.inverse(plan_, run_of(task_, window, rows, out));
  }

  int iterations() const noexcept override { return 1; }
  std::string_view isa() const noexcept override { return kernels_.isa; }

 private:
  StreamTask task_;
  Grid grid_;
  const Kernels& kernels_;
  InversePlan plan_;
};

}  // namespace

std::unique_ptr<Solver> make_admm_solver(const StreamTask& task) { return std::make_unique<AdmmSolver>(task); }
std::unique_ptr<Solver> make_inverse_solver(const StreamTask& task) { return std::make_unique<InverseSolver>(task); }

}  // namespace bolo::deblur

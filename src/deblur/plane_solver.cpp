#include "src/deblur/plane_solver.hpp"

#include <algorithm>
#include <array>
#include <utility>

#include "src/deblur/samples.hpp"

namespace bolo::deblur {

PlaneSolver::PlaneSolver(const StreamTask& task, std::unique_ptr<PixelMethod> method)
    : task_(task), grid_(reduce(task.settings, 0.0)), method_(std::move(method)) {}

void PlaneSolver::prepare(const WindowView& window) noexcept {
  const Pattern pattern = pattern_of(window);
  if (pattern == pattern_) return;
  pattern_ = pattern;
  method_->prepare(pattern);
}

PixelRun run_for(const StreamTask& task) noexcept {
  const bool kelvin = task.output == PixelType::kFloat32 && task.input.scale.unit == Unit::kKelvin;
  PixelRun run;
  run.input = task.input.type;
  run.output = task.output;
  run.scale = kelvin ? static_cast<float>(task.input.scale.scale) : 1.0F;
  run.offset = kelvin ? static_cast<float>(task.input.scale.offset) : 0.0F;
  return run;
}

PixelRun PlaneSolver::run_into(void* out) const noexcept {
  PixelRun run = run_for(task_);
  run.out = out;
  run.published = published_bins(grid_, pattern_.slots, pattern_.target);
  return run;
}

void PlaneSolver::solve(const WindowView& window, const Region& part, void* out) const noexcept {
  const auto width = static_cast<std::size_t>(task_.input.geometry.width);
  PixelRun run = run_into(out);
  run.planes = window.planes.data();
  const bool whole_rows = part.x == 0 && part.width == task_.input.geometry.width;
  const int step = whole_rows ? part.height : 1;
  for (int row = part.y; row < part.y + part.height; row += step) {
    run.begin = static_cast<std::size_t>(row) * width + static_cast<std::size_t>(part.x);
    run.end = run.begin + static_cast<std::size_t>(whole_rows ? step * part.width : part.width);
    method_->run(run);
  }
}

void PlaneSolver::solve_points(const WindowView& window, std::span<const std::uint32_t> pixels,
                               void* out) const noexcept {
  SampleBlock block;
  const std::size_t size = bytes_of(task_.output);
  for (std::size_t done = 0; done < pixels.size(); done += SampleBlock::kPixels) {
    const auto some = pixels.subspan(done, std::min(SampleBlock::kPixels, pixels.size() - done));
    block.gather(window, pattern_, task_.input.type, some);
    PixelRun run = run_into(static_cast<std::byte*>(out) + done * size);
    run.input = PixelType::kFloat32;
    run.planes = block.planes();
    run.end = some.size();
    method_->run(run);
  }
}

}  // namespace bolo::deblur

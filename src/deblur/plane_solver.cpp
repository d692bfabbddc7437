#include "src/deblur/plane_solver.hpp"

#include <algorithm>
#include <utility>

#include "src/deblur/row_time.hpp"

namespace bolo::deblur {

PlaneSolver::PlaneSolver(const StreamTask& task, Correction correction, std::unique_ptr<PixelMethod> method)
    : task_(task), grid_(reduce(task.settings, 0.0)), correction_(std::move(correction)), method_(std::move(method)) {}

void PlaneSolver::prepare(const WindowView& window) noexcept {
  const Pattern pattern = pattern_of(window);
  if (pattern == pattern_) return;
  pattern_ = pattern;
  method_->prepare(pattern);
}

int PlaneSolver::row_of(std::size_t pixel) const noexcept {
  return static_cast<int>(pixel / static_cast<std::size_t>(task_.input.geometry.width));
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

PixelRun PlaneSolver::run_into(void* out, int row) const noexcept {
  PixelRun run = run_for(task_);
  run.out = out;
  run.delay = correction_.row_delay(row);
  run.published = published_bins(grid_, pattern_.slots, pattern_.target, run.delay);
  return run;
}

void PlaneSolver::solve(const WindowView& window, const Region& part, void* out) const noexcept {
  const auto width = static_cast<std::size_t>(task_.input.geometry.width);
  const bool together = part.x == 0 && part.width == task_.input.geometry.width && !correction_.delays_rows();
  const int step = together ? part.height : 1;
  for (int row = part.y; row < part.y + part.height; row += step) {
    const std::size_t first = static_cast<std::size_t>(row) * width + static_cast<std::size_t>(part.x);
    const std::size_t count = static_cast<std::size_t>(step) * static_cast<std::size_t>(part.width);
    if (correction_.changes_samples()) {
      solve_packed(window, first, count, row, static_cast<std::byte*>(out) + first * bytes_of(task_.output));
      continue;
    }
    PixelRun run = run_into(out, row);
    run.planes = window.planes.data();
    run.begin = first;
    run.end = first + count;
    method_->run(run);
  }
}

void PlaneSolver::solve_packed(const WindowView& window, std::size_t first, std::size_t count, int row,
                               void* out) const noexcept {
  SampleBlock block(correction_);
  PixelRun run = run_into(out, row);
  run.input = PixelType::kFloat32;
  run.planes = block.planes();
  const SlotRange slots = method_->needed(run.delay);
  for (std::size_t done = 0; done < count; done += run.end) {
    run.end = std::min(SampleBlock::kPixels, count - done);
    run.out = static_cast<std::byte*>(out) + done * bytes_of(task_.output);
    block.read(window, pattern_, first + done, run.end, slots);
    method_->run(run);
  }
}

void PlaneSolver::solve_points(const WindowView& window, std::span<const std::uint32_t> pixels,
                               void* out) const noexcept {
  SampleBlock block(correction_);
  for (std::size_t done = 0; done < pixels.size();) {
    std::span<const std::uint32_t> some = pixels.subspan(done, std::min(SampleBlock::kPixels, pixels.size() - done));
    const int row = row_of(some.front());
    if (correction_.delays_rows()) {  // what is published differs from row to row
      const auto other = std::find_if(some.begin(), some.end(), [&](std::uint32_t p) { return row_of(p) != row; });
      some = some.first(static_cast<std::size_t>(other - some.begin()));
    }
    block.gather(window, pattern_, some, method_->needed(correction_.row_delay(row)));
    PixelRun run = run_into(static_cast<std::byte*>(out) + done * bytes_of(task_.output), row);
    run.input = PixelType::kFloat32;
    run.planes = block.planes();
    run.end = some.size();
    method_->run(run);
    done += some.size();
  }
}

}  // namespace bolo::deblur

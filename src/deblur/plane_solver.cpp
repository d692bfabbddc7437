#include "src/deblur/plane_solver.hpp"

#include <algorithm>
#include <array>
#include <utility>

#include "src/deblur/grid.hpp"

namespace bolo::deblur {
namespace {

constexpr std::size_t kPacked = 256;  // points at a time: their samples stay in the first two caches

// The samples of single pixels beside each other, a row of floats for each received frame of a window.
class PackedSamples {
 public:
  PackedSamples() noexcept {
    for (std::size_t s = 0; s < planes_.size(); ++s) planes_[s] = values_[s].data();
  }

  void take(const WindowView& window, PixelType type, std::span<const std::uint32_t> pixels) noexcept {
    for (std::size_t s = 0; s < window.planes.size(); ++s) {
      if (window.planes[s] == nullptr) continue;
      type == PixelType::kUint16 ? pick<std::uint16_t>(window.planes[s], pixels, values_[s].data())
                                 : pick<float>(window.planes[s], pixels, values_[s].data());
    }
  }
  const void* const* planes() const noexcept { return planes_.data(); }

 private:
  template <typename T>
  static void pick(const void* plane, std::span<const std::uint32_t> pixels, float* to) noexcept {
    const T* from = static_cast<const T*>(plane);
    for (std::size_t i = 0; i < pixels.size(); ++i) to[i] = static_cast<float>(from[pixels[i]]);
  }

  alignas(64) std::array<std::array<float, kPacked>, kMaxSlots> values_;
  std::array<const void*, kMaxSlots> planes_;
};

}  // namespace

PlaneSolver::PlaneSolver(const StreamTask& task, std::unique_ptr<PixelMethod> method)
    : task_(task), grid_(reduce(task.settings, 0.0)), method_(std::move(method)) {}

void PlaneSolver::prepare(const WindowView& window, Crew& /*crew*/) noexcept {
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
  run.delay = task_.row_delay(row);
  run.published = published_bins(grid_, pattern_, run.delay);
  return run;
}

void PlaneSolver::solve(const WindowView& window, const Region& part, void* out) const noexcept {
  const auto width = static_cast<std::size_t>(task_.input.geometry.width);
  const bool together = part.x == 0 && part.width == task_.input.geometry.width && !task_.delays_rows();
  const int step = together ? part.height : 1;
  for (int row = part.y; row < part.y + part.height; row += step) {
    const std::size_t first = static_cast<std::size_t>(row) * width + static_cast<std::size_t>(part.x);
    const std::size_t count = static_cast<std::size_t>(step) * static_cast<std::size_t>(part.width);
    PixelRun run = run_into(out, row);
    run.planes = window.planes.data();
    run.begin = first;
    run.end = first + count;
    method_->run(run);
  }
}

void PlaneSolver::solve_points(const WindowView& window, std::span<const std::uint32_t> pixels,
                               void* out) const noexcept {
  PackedSamples samples;
  for (std::size_t done = 0; done < pixels.size();) {
    std::span<const std::uint32_t> some = pixels.subspan(done, std::min(kPacked, pixels.size() - done));
    const int row = row_of(some.front());
    if (task_.delays_rows()) {  // what is published differs from row to row
      const auto other = std::find_if(some.begin(), some.end(), [&](std::uint32_t p) { return row_of(p) != row; });
      some = some.first(static_cast<std::size_t>(other - some.begin()));
    }
    samples.take(window, task_.input.type, some);
    PixelRun run = run_into(static_cast<std::byte*>(out) + done * bytes_of(task_.output), row);
    run.input = PixelType::kFloat32;
    run.whole = task_.input.type == PixelType::kUint16;
    run.planes = samples.planes();
    run.end = some.size();
    method_->run(run);
    done += some.size();
  }
}

}  // namespace bolo::deblur

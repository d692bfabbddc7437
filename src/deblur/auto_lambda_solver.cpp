#include "src/deblur/auto_lambda_solver.hpp"

#include <algorithm>
#include <array>

#include "src/deblur/row_time.hpp"

namespace bolo::deblur {
namespace {

// The method's plan is made for this lambda_half, K: as many iterations as the largest choices want in usual noise.
constexpr double kPlannedLambda = 0.5;

StreamTask planned(StreamTask task) {
  task.settings.lambda = 2.0 * task.settings.kappa * kPlannedLambda;
  if (task.input.scale.unit != Unit::kKelvin) task.settings.lambda /= task.kelvin_per_value();
  return task;
}

// The sample itself, as run() would have written an estimate.
void publish_raw(const PixelRun& run, const void* plane, std::size_t pixel) noexcept {
  const bool count = run.input == PixelType::kUint16;
  const std::uint16_t raw = count ? static_cast<const std::uint16_t*>(plane)[pixel] : std::uint16_t{0};
  const float value = count ? static_cast<float>(raw) : static_cast<const float*>(plane)[pixel];
  if (run.output == PixelType::kFloat32) {
    static_cast<float*>(run.out)[pixel] = run.scale * value + run.offset;
  } else {
    static_cast<std::uint16_t*>(run.out)[pixel] = raw;
  }
}

}  // namespace

AutoLambdaSolver::AutoLambdaSolver(const StreamTask& task)
    : task_(planned(task)),
      grid_(reduce(task_.settings, 0.0)),
      posterior_(task_),
      risk_(task_, posterior_.models()),
      method_(make_method(task_)),
      run_(run_for(task_)) {}

double AutoLambdaSolver::noise_k() const noexcept { return task_.in_kelvin(posterior_.noise()); }

void AutoLambdaSolver::prepare(const WindowView& window) noexcept {
  const Pattern pattern = pattern_of(window);
  posterior_.prepare(window, pattern);
  if (pattern == pattern_) return;
  pattern_ = pattern;
  method_->prepare(pattern);
}

void AutoLambdaSolver::solve(const WindowView& window, const Region& part, void* out) const noexcept {
  const std::size_t bytes = bytes_of(task_.output);
  const std::size_t stride = static_cast<std::size_t>(task_.input.geometry.width) * bytes;
  const int columns = static_cast<int>(kStatColumns);
  for (int x = part.x; x < part.x + part.width;) {
    const int end = std::min(part.x + part.width, (x / columns + 1) * columns);
    for (int y = part.y; y < part.y + part.height;) {
      const int below = std::min(part.y + part.height, (y / kStatBlock + 1) * kStatBlock);
      const std::size_t first = static_cast<std::size_t>(y) * stride + static_cast<std::size_t>(x) * bytes;
      solve_blocks(window, {x, y, end - x, below - y}, static_cast<std::byte*>(out) + first, stride);
      y = below;
    }
    x = end;
  }
}

void AutoLambdaSolver::solve_points(const WindowView& window, std::span<const std::uint32_t> pixels,
                                    void* out) const noexcept {
  const auto width = static_cast<std::uint32_t>(task_.input.geometry.width);
  auto* to = static_cast<std::byte*>(out);
  for (const std::uint32_t pixel : pixels) {
    solve_blocks(window, {static_cast<int>(pixel % width), static_cast<int>(pixel / width), 1, 1}, to, 0);
    to += bytes_of(task_.output);
  }
}

// `part` lies in one row of blocks and in kStatBlocks of them.
void AutoLambdaSolver::solve_blocks(const WindowView& window, const Region& part, std::byte* out,
                                    std::size_t stride) const noexcept {
  const int first = part.x / kStatBlock;
  const int count = (part.x + part.width - 1) / kStatBlock - first + 1;
  Posteriors posteriors;
  posterior_.find(window, part.y / kStatBlock, first, count, posteriors);
  const std::array<int, kStatBlocks> best = risk_.best(posteriors, count);
  std::array<int, kStatColumns> choice{};
  for (int block = 0; block < count; ++block) {
    const int begin = std::max(0, (first + block) * kStatBlock - part.x);
    const int end = std::min(part.width, (first + block + 1) * kStatBlock - part.x);
    std::fill(choice.begin() + begin, choice.begin() + end, best[static_cast<std::size_t>(block)]);
  }
  for (int y = 0; y < part.height; ++y) {
    const Region row{part.x, part.y + y, part.width, 1};
    solve_row(window, row, choice.data(), out + static_cast<std::size_t>(y) * stride);
  }
}

void AutoLambdaSolver::solve_row(const WindowView& window, const Region& part, const int* choice,
                                 std::byte* out) const noexcept {
  const auto noise = static_cast<float>(posterior_.noise());
  const auto columns = static_cast<std::size_t>(part.width);
  std::array<float, kStatColumns> lambda{};
  bool any = false;
  for (std::size_t i = 0; i < columns; ++i) {
    const bool raw = choice[i] == kRawChoice;
    lambda[i] = noise * kLambdaSteps[raw ? 0 : static_cast<std::size_t>(choice[i])];
    any |= raw;
  }
  PixelRun run = run_;
  run.delay = task_.row_delay(part.y);
  run.published = published_bins(grid_, pattern_.slots, pattern_.target, run.delay);
  run.end = columns;
  run.out = out;
  run.lambda = lambda.data();
  const std::size_t first = static_cast<std::size_t>(part.y) * static_cast<std::size_t>(task_.input.geometry.width) +
                            static_cast<std::size_t>(part.x);
  std::array<const void*, kMaxSlots> planes{};
  for (std::size_t s = 0; s < static_cast<std::size_t>(pattern_.slots); ++s) {
    if (!pattern_.received[s]) continue;
    planes[s] = static_cast<const std::byte*>(window.planes[s]) + first * bytes_of(task_.input.type);
  }
  run.planes = planes.data();
  method_->run(run);
  if (!any) return;
  const void* target = run.planes[static_cast<std::size_t>(pattern_.target)];
  for (std::size_t i = 0; i < columns; ++i) {
    if (choice[i] == kRawChoice) publish_raw(run, target, i);
  }
}

}  // namespace bolo::deblur

#include "src/deblur/mmae_solver.hpp"

#include <algorithm>

#include "src/deblur/method.hpp"

namespace bolo::deblur {
namespace {

constexpr int kHalf = kStatBlock / 2;

}  // namespace

// The blocks whose weights some columns need: those on both sides.
struct MmaeSolver::Columns {
  int first = 0;  // may be -1: the frame's first block replaces it
  int last = 0;   // may be one too many: the frame's last block replaces it
};

MmaeSolver::MmaeSolver(const StreamTask& task) : task_(task), posterior_(task) {}

double MmaeSolver::noise_k() const noexcept { return task_.in_kelvin(posterior_.noise()); }
bool MmaeSolver::set_noise(double noise_k) noexcept {
  posterior_.set_noise(noise_k);
  return true;
}
double MmaeSolver::measured_noise_k() const noexcept { return task_.in_kelvin(posterior_.measured_noise()); }

void MmaeSolver::prepare(const WindowView& window, Crew& crew) noexcept {
  posterior_.prepare(window, pattern_of(window), crew);
}

void MmaeSolver::solve(const WindowView& window, const Region& part, void* out) const noexcept {
  solve(window, part, out, nullptr);
}

void MmaeSolver::solve(const WindowView& window, const Region& part, void* out, float* errors) const noexcept {
  const std::size_t bytes = bytes_of(task_.output);
  const std::size_t stride = static_cast<std::size_t>(task_.input.geometry.width) * bytes;
  for (int x = part.x; x < part.x + part.width; x += kCellColumns) {
    const Region some{x, part.y, std::min(kCellColumns, part.x + part.width - x), part.height};
    const std::size_t first = static_cast<std::size_t>(part.y) * stride + static_cast<std::size_t>(x) * bytes;
    solve_columns(window, some, static_cast<std::byte*>(out) + first, stride, errors);
  }
}

void MmaeSolver::solve_points(const WindowView& window, std::span<const std::uint32_t> pixels,
                              void* out) const noexcept {
  const auto width = static_cast<std::uint32_t>(task_.input.geometry.width);
  auto* to = static_cast<std::byte*>(out);
  for (const std::uint32_t pixel : pixels) {
    solve_columns(window, {static_cast<int>(pixel % width), static_cast<int>(pixel / width), 1, 1}, to, 0, nullptr);
    to += bytes_of(task_.output);
  }
}

// Processes rows from block centre to block centre, so that each row of blocks is processed once.
void MmaeSolver::solve_columns(const WindowView& window, const Region& part, std::byte* out, std::size_t stride,
                               float* errors) const noexcept {
  const Columns columns{(part.x + kHalf) / kStatBlock - 1, (part.x + part.width - 1 + kHalf) / kStatBlock};
  const auto width = static_cast<std::size_t>(task_.input.geometry.width);
  const PixelRun run = run_for(task_);
  FilterRow row;
  row.type = run.input;
  row.output = run.output;
  row.scale = run.scale;
  row.offset = run.offset;
  row.first_column = part.x;
  row.first_block = columns.first;
  row.columns = part.width;
  BlockWeights weights[2];
  BlockWeights* above = &weights[0];
  BlockWeights* below = &weights[1];
  int upper = (part.y + kHalf) / kStatBlock - 1;
  find_weights(window, upper, columns, *above);
  for (int y = part.y; y < part.y + part.height; ++upper) {
    if (upper < 0 || upper + 1 >= posterior_.blocks_down()) {
      *below = *above;  // beyond the frame, its first or last row of blocks is used
    } else {
      find_weights(window, upper + 1, columns, *below);
    }
    const int top = (upper + 1) * kStatBlock;
    if (errors != nullptr && top >= part.y && top < part.y + part.height) {
      const int own = std::max(columns.first, 0);
      const int blocks = std::min(columns.last, posterior_.blocks_across() - 1) - own + 1;
      const int at = (upper + 1) * posterior_.blocks_across() + own;
      std::copy_n(below->tap[kMostSamples] + own - columns.first, blocks, errors + at);
    }
    const int end = std::min(part.y + part.height, (upper + 1) * kStatBlock + kHalf);
    for (; y < end; ++y) {
      const std::size_t pixel = static_cast<std::size_t>(y) * width + static_cast<std::size_t>(part.x);
      row.down = (static_cast<float>((y + kHalf) % kStatBlock) + 0.5F) / kStatBlock;
      row.out = out + static_cast<std::size_t>(y - part.y) * stride;
      filter_row(window, pixel, row, *above, *below);
    }
    std::swap(above, below);
  }
}

void MmaeSolver::filter_row(const WindowView& window, std::size_t pixel, FilterRow& row, const BlockWeights& above,
                            const BlockWeights& below) const noexcept {
  const ModelTables& tables = posterior_.tables();
  for (int i = 0; i < tables.samples; ++i) {
    const auto slot = static_cast<std::size_t>(tables.slot[static_cast<std::size_t>(i)]);
    row.samples[i] = static_cast<const std::byte*>(window.planes[slot]) + pixel * bytes_of(row.type);
  }
  posterior_.kernels().filter(tables.samples, row, above, below);
}

void MmaeSolver::find_weights(const WindowView& window, int block_row, const Columns& columns,
                              BlockWeights& weights) const noexcept {
  const int row = std::clamp(block_row, 0, posterior_.blocks_down() - 1);
  const int begin = std::max(columns.first, 0);
  const int end = std::min(columns.last, posterior_.blocks_across() - 1) + 1;
  Posteriors posteriors;
  for (int block = begin; block < end; block += kStatBlocks) {
    const int count = std::min(kStatBlocks, end - block);
    posterior_.find(window, row, block, count, posteriors);
    posterior_.kernels().mix(posterior_.tables(), posterior_.weights_of(row), posteriors, count, weights,
                             block - columns.first);
  }
  for (int i = 0; i < posterior_.tables().samples; ++i) {
    float* tap = weights.tap[i];
    if (begin > columns.first) tap[0] = tap[1];
    if (end <= columns.last) tap[columns.last - columns.first] = tap[end - 1 - columns.first];
  }
}

}  // namespace bolo::deblur

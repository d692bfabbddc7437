#include "src/deblur/motion_posterior.hpp"

#include <algorithm>
#include <array>

namespace bolo::deblur {
namespace {

constexpr std::size_t kOtherPatterns = 8;

std::vector<double> read_out_offsets(const StreamTask& task, const Correction& correction) {
  std::vector<double> offsets;
  const int last = correction.delays_rows() ? task.input.geometry.height : 1;
  for (int row = 0; row < last; row += kStatBlock) {
    const double middle =
        correction.row_delay(row) + 0.5 * (correction.row_delay(row + kStatBlock - 1) - correction.row_delay(row));
    offsets.push_back(middle * task.settings.period_s);
  }
  return offsets;
}

}  // namespace

MotionPosterior::MotionPosterior(const StreamTask& task, const Correction& correction)
    : geometry_(task.input.geometry),
      type_(correction.changes_samples() ? PixelType::kFloat32 : task.input.type),
      window_(task.settings.window),
      correction_(correction),
      models_(task.settings, read_out_offsets(task, correction)),
      noise_(task),
      kernels_(best_mmae_kernels()) {
  const Pattern all = whole_pattern(task.settings);
  const auto add = [this](const Pattern& pattern) {
    tables_.push_back(models_.make_tables());
    models_.prepare(tables_.back(), pattern);
  };
  add(all);
  for (int lost = all.slots - models_.slots(); lost < all.slots; ++lost) {
    if (lost == all.target) continue;
    Pattern pattern = all;
    pattern.received[static_cast<std::size_t>(lost)] = false;
    --pattern.count;
    pattern.first = lost == 0 ? 1 : 0;
    add(pattern);
  }
  kept_ = tables_.size();
  for (std::size_t i = 0; i < kOtherPatterns; ++i) add(all);
}

void MotionPosterior::prepare(const WindowView& window, const Pattern& pattern) noexcept {
  noise_.look(window, pattern);
  current_ = place_of(pattern);
}

std::size_t MotionPosterior::place_of(const Pattern& pattern) noexcept {
  const auto seen = pattern.received.begin() + (pattern.slots - models_.slots());
  for (std::size_t i = 0; i < tables_.size(); ++i) {
    const auto known = tables_[i].pattern.received.begin() + (pattern.slots - models_.slots());
    if (std::equal(seen, seen + models_.slots(), known)) return i;
  }
  const std::size_t place = kept_ + next_;
  next_ = (next_ + 1) % kOtherPatterns;
  models_.prepare(tables_[place], pattern);
  return place;
}

void MotionPosterior::find(const WindowView& window, int block_row, int first, int count,
                           Posteriors& out) const noexcept {
  const auto width = static_cast<std::size_t>(geometry_.width);
  const int top = block_row * kStatBlock;
  BlockSamples samples;
  samples.type = type_;
  samples.columns = std::min(geometry_.width - first * kStatBlock, count * kStatBlock);
  samples.rows = std::min(kStatRows, (geometry_.height - top + kStatRowStep - 1) / kStatRowStep);
  const std::size_t pixel = static_cast<std::size_t>(top) * width + static_cast<std::size_t>(first * kStatBlock);
  const auto inverse_noise = static_cast<float>(1.0 / noise());
  if (!correction_.changes_samples()) {
    point_at_planes(window, pixel, kStatRowStep * width, samples);
    kernels_.posteriors(tables(), samples, inverse_noise, out);
    return;
  }
  SampleBlock block(correction_);
  point_at_corrected(window, pixel, kStatRowStep * width, block, samples);
  kernels_.posteriors(tables(), samples, inverse_noise, out);
}

void MotionPosterior::point_at_planes(const WindowView& window, std::size_t first, std::size_t stride,
                                      BlockSamples& samples) const noexcept {
  const ModelTables& t = tables();
  for (int r = 0; r < samples.rows; ++r) {
    const std::size_t at = (first + static_cast<std::size_t>(r) * stride) * bytes_of(type_);
    for (int i = 0; i < t.samples; ++i) {
      const auto slot = static_cast<std::size_t>(t.slot[static_cast<std::size_t>(i)]);
      samples.values[r][i] = static_cast<const std::byte*>(window.planes[slot]) + at;
    }
  }
}

void MotionPosterior::point_at_corrected(const WindowView& window, std::size_t first, std::size_t stride,
                                         SampleBlock& block, BlockSamples& samples) const noexcept {
  static_assert(kStatRows * kStatColumns <= SampleBlock::kPixels);
  const ModelTables& t = tables();
  const auto columns = static_cast<std::size_t>(samples.columns);
  std::array<std::uint32_t, SampleBlock::kPixels> pixels{};
  std::size_t count = 0;
  for (int r = 0; r < samples.rows; ++r) {
    const std::size_t at = first + static_cast<std::size_t>(r) * stride;
    for (std::size_t x = 0; x < columns; ++x) pixels[count++] = static_cast<std::uint32_t>(at + x);
  }
  block.gather(window, t.pattern, {pixels.data(), count}, slots());
  for (int r = 0; r < samples.rows; ++r) {
    for (int i = 0; i < t.samples; ++i) {
      const auto slot = static_cast<std::size_t>(t.slot[static_cast<std::size_t>(i)]);
      samples.values[r][i] = block.slot(slot) + static_cast<std::size_t>(r) * columns;
    }
  }
}

}  // namespace bolo::deblur

#include "src/deblur/motion_posterior.hpp"

#include <algorithm>
#include <utility>

namespace bolo::deblur {
namespace {

constexpr std::size_t kOtherPatterns = 8;

}  // namespace

MotionPosterior::MotionPosterior(const StreamTask& task, std::vector<double> offsets_s)
    : geometry_(task.input.geometry),
      type_(task.input.type),
      models_(task.settings, std::move(offsets_s)),
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
  const ModelTables& t = tables();
  BlockSamples samples;
  samples.type = type_;
  samples.columns = std::min(geometry_.width - first * kStatBlock, count * kStatBlock);
  const auto width = static_cast<std::size_t>(geometry_.width);
  const std::size_t bytes = bytes_of(type_);
  for (int r = 0; r < kStatRows; ++r) {
    const int row = block_row * kStatBlock + r * kStatRowStep;
    if (row >= geometry_.height) break;
    const std::size_t pixel = static_cast<std::size_t>(row) * width + static_cast<std::size_t>(first * kStatBlock);
    for (int i = 0; i < t.samples; ++i) {
      const auto slot = static_cast<std::size_t>(t.slot[static_cast<std::size_t>(i)]);
      samples.values[r][i] = static_cast<const std::byte*>(window.planes[slot]) + pixel * bytes;
    }
    ++samples.rows;
  }
  kernels_.posteriors(t, samples, static_cast<float>(1.0 / noise()), out);
}

}  // namespace bolo::deblur

#include "src/deblur/motion_posterior.hpp"

#include <algorithm>

namespace bolo::deblur {
namespace {

constexpr std::size_t kOtherPatterns = 8;

std::vector<double> read_out_offsets(const StreamTask& task) {
  std::vector<double> offsets;
  const int last = task.delays_rows() ? task.input.geometry.height : 1;
  for (int row = 0; row < last; row += kStatBlock) {
    const double middle = task.row_delay(row) + 0.5 * (task.row_delay(row + kStatBlock - 1) - task.row_delay(row));
    offsets.push_back(middle * task.settings.period_s);
  }
  return offsets;
}

}  // namespace

MotionPosterior::MotionPosterior(const StreamTask& task)
    : geometry_(task.input.geometry),
      type_(task.input.type),
      delays_rows_(task.delays_rows()),
      models_(task.settings, read_out_offsets(task)),
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

void MotionPosterior::prepare(const WindowView& window, const Pattern& pattern, Crew& crew) noexcept {
  noise_.update(window, pattern, crew);
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
  point_at_planes(window, pixel, kStatRowStep * width, samples);
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

}  // namespace bolo::deblur

#include "src/deblur/grid.hpp"

#include <algorithm>
#include <cmath>

#include "src/model/bolometer.hpp"

namespace bolo::deblur {

// ||D||_1 over K coefficients is sqrt(K / bins) times that over `bins`: a step function has the same norm in both
// bases, but its values are repeated K / bins times.
Grid reduce(const Settings& settings, double lambda_half) {
  Grid grid;
  const int all = 1 << settings.levels;
  grid.frames = settings.window - 1;
  grid.ratio = settings.period_s / settings.tau_s;
  grid.bins = std::min(all, grid.frames);
  if (all > grid.frames && model::fine_column_bound(grid.frames, settings.period_s, settings.tau_s) >= 1.0) {
    const int level = model::strongest_wavelet_level(settings.period_s, settings.tau_s);
    grid.bins = std::min(all, grid.frames << std::min(level + 1, 10));
  }
  grid.parts = std::max(1, grid.bins / grid.frames);
  grid.frames_per_bin = std::max(1, grid.frames / grid.bins);
  grid.lambda_scale = std::sqrt(static_cast<double>(all) / grid.bins);
  grid.lambda = lambda_half * grid.lambda_scale;
  return grid;
}

WithinFrame within_frame(const Settings& settings) {
  const int frames = settings.window - 1;
  const int all = 1 << settings.levels;
  if (all <= frames || model::fine_column_bound(frames, settings.period_s, settings.tau_s) < 1.0) return {};
  const int deepest = static_cast<int>(std::lround(std::log2(all / frames))) - 1;
  WithinFrame w;
  w.used = true;
  w.level = std::min(model::strongest_wavelet_level(settings.period_s, settings.tau_s), deepest);
  const double parts = std::exp2(w.level);
  w.value = 1.0 / std::sqrt(all / (frames * parts));
  const double edge = std::expm1(-settings.period_s / (2.0 * parts * settings.tau_s));
  w.effect = -edge * edge * w.value;
  return w;
}

int Pattern::before(int slot) const {
  for (int s = slot - 1; s >= 0; --s) {
    if (received[static_cast<std::size_t>(s)]) return s;
  }
  return -1;
}

int Pattern::after(int slot) const {
  for (int s = slot + 1; s < slots; ++s) {
    if (received[static_cast<std::size_t>(s)]) return s;
  }
  return -1;
}

Pattern whole_pattern(const Settings& settings) noexcept {
  Pattern pattern;
  pattern.slots = settings.window;
  pattern.target = settings.window - 1 - settings.lookahead;
  pattern.count = settings.window;
  std::fill_n(pattern.received.begin(), settings.window, true);
  return pattern;
}

Pattern pattern_of(const WindowView& window) noexcept {
  Pattern pattern;
  pattern.slots = std::min(static_cast<int>(window.planes.size()), kMaxSlots);
  pattern.target = window.target;
  pattern.first = -1;
  for (int s = 0; s < pattern.slots; ++s) {
    if (window.planes[static_cast<std::size_t>(s)] == nullptr) continue;
    pattern.received[static_cast<std::size_t>(s)] = true;
    ++pattern.count;
    if (pattern.first < 0) pattern.first = s;
  }
  pattern.first = std::max(pattern.first, 0);
  return pattern;
}

Published published_bins(const Grid& grid, int slots, int target) noexcept {
  const int after = target * grid.bins / grid.frames;
  const int before = (target * grid.bins - 1) / grid.frames;
  if (target == slots - 1) return {before, before};
  return {before, after};
}

Published published_bins(const Grid& grid, int slots, int target, double delay) noexcept {
  const int last = (slots - 1) * grid.parts - 1;
  const double q = grid.parts * (target - delay) - 0.5;
  const double whole = std::floor(q);
  const auto after = static_cast<float>(q - whole);
  const auto bin = [&](double step) {
    return static_cast<int>(std::clamp(step, 0.0, static_cast<double>(last))) / grid.frames_per_bin;
  };
  return {bin(whole), bin(whole + 1.0), 1.0F - after, after};
}

Published published_bins(const Grid& grid, const Pattern& pattern, double delay) noexcept {
  return published_bins(grid, pattern.before(pattern.slots) + 1, pattern.target, delay);
}

}  // namespace bolo::deblur

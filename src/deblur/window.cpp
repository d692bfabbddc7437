#include "src/deblur/window.hpp"

#include <algorithm>
#include <cmath>

namespace bolo::deblur {
namespace {

// A camera's time stamps jitter by its clock's steps and its firmware's haste. A tenth of a period moves a sample by
// less than the error that one frame of noise makes at 10 K of contrast; beyond it the frame is flagged.
constexpr double kGridTolerance = 0.1;

}  // namespace

Window::Window(const Settings& settings)
    : target_(static_cast<std::size_t>(settings.window - 1 - settings.lookahead)),
      period_ns_(settings.period_s * 1e9),
      places_(static_cast<std::size_t>(settings.window)),
      planes_(static_cast<std::size_t>(settings.window)) {
  released_.reserve(static_cast<std::size_t>(slots()));
}

// Periods from the last frame to this one. Two witnesses: the camera's clock and its counter. When they disagree the
// clock is right as long as it shows a whole number of periods (cameras lose frames without a jump in the counter);
// off the grid it is the clock that is doubtful.
std::int64_t Window::steps_to(const FrameMeta& meta, bool& off_grid) const noexcept {
  const double periods = (static_cast<double>(meta.camera_ns) - static_cast<double>(last_.camera_ns)) / period_ns_;
  const double nearest = std::clamp(std::round(periods), -1.0, 1e9);
  const bool clock_fits = nearest >= 1.0 && std::abs(periods - nearest) <= kGridTolerance;
  const auto counted = static_cast<std::int64_t>(meta.frame_id - last_.frame_id);
  const std::int64_t steps = clock_fits || periods < 0.0 ? static_cast<std::int64_t>(nearest) : counted;
  off_grid = std::abs(periods - static_cast<double>(steps)) > kGridTolerance;
  return steps;
}

bool Window::push(const WindowFrame& frame, bool restart) noexcept {
  released_.clear();
  incoming_ = frame;
  steps_left_ = 1;
  bool emptied = false;
  if (covered_ > 0) {
    bool off_grid = false;
    const std::int64_t steps = steps_to(frame.meta, off_grid);
    emptied = restart || steps < 1 || steps >= static_cast<std::int64_t>(places_.size());
    if (!emptied) {
      steps_left_ = steps;
      if (off_grid) incoming_.meta.flags |= kFlagJitter;
    }
  }
  if (emptied) finish_window();
  last_ = frame.meta;
  return emptied;
}

void Window::finish() noexcept {
  released_.clear();
  finish_window();
}

bool Window::next(Ready& ready) noexcept {
  while (drain_left_ > 0) {
    advance();
    const bool shown = show_target(ready, false);
    if (--drain_left_ == 0) clear();
    if (shown) return true;
  }
  while (steps_left_ > 0) {
    advance();
    covered_ = std::min(covered_ + 1, places_.size());
    if (--steps_left_ == 0) place(places_.size() - 1) = {incoming_, true};
    if (show_target(ready, covered_ == places_.size())) return true;
  }
  return false;
}

// What waits for its look-ahead is shown first, then the window empties.
void Window::finish_window() noexcept {
  drain_left_ = places_.size() - 1 - target_;
  if (drain_left_ == 0) clear();
}

// One period on: the oldest place leaves, the newest is empty.
void Window::advance() noexcept {
  Place& oldest = places_[oldest_];
  if (oldest.taken) released_.push_back(oldest.frame.token);
  oldest.taken = false;
  oldest_ = (oldest_ + 1) % places_.size();
  ++periods_;
}

void Window::clear() noexcept {
  for (std::size_t i = 0; i < places_.size(); ++i) advance();
  covered_ = 0;
}

bool Window::show_target(Ready& ready, bool full) noexcept {
  const Place& target = place(target_);
  if (!target.taken) return false;
  bool gap = false;
  for (std::size_t i = 0; i < planes_.size(); ++i) {
    const Place& p = place(i);
    planes_[i] = p.taken ? p.frame.plane : nullptr;
    gap |= !p.taken;
  }
  ready.frame = target.frame;
  ready.view = {planes_, static_cast<int>(target_), periods_};
  ready.full = full;
  if (!full) ready.frame.meta.flags |= kFlagWarmUp;
  if (full && gap) ready.frame.meta.flags |= kFlagGap;
  return true;
}

}  // namespace bolo::deblur

#include "src/deblur/window.hpp"

#include <algorithm>
#include <cmath>

namespace bolo::deblur {
namespace {

// A camera's time stamps jitter by its clock's resolution and its firmware's delays. A tenth of a period moves a sample
// by less than the error of one frame's noise at 10 K of contrast; beyond it the frame is flagged.
constexpr double kGridTolerance = 0.1;
constexpr double kMostJitter = 1.0;  // periods by which a clock may err: time stamps of a busy host
constexpr int kScatterSteps = 16;    // steps over which the clock's scatter is averaged
constexpr int kDriftSteps = 20;  // steps that reveal a wrong period: one of 0.5 % leaves the grid's tolerance in these
constexpr int kSteadySteps = 4;  // steady steps assumed at the start: one late stamp is no scatter
constexpr double kBeyondChance = 5;  // mean distances: four standard deviations

}  // namespace

std::int64_t FrameSteps::next(const FrameMeta& frame, std::uint64_t repeats, double period_s, bool& off_grid) noexcept {
  const double passed_ns = static_cast<double>(frame.camera_ns) - static_cast<double>(last_.camera_ns);
  const double periods = passed_ns / (period_s * 1e9);
  const double nearest = std::clamp(std::round(periods), -1.0, 1e9);
  const bool clock_fits = nearest >= 1.0 && std::abs(periods - nearest) <= kGridTolerance;
  const auto all = static_cast<std::int64_t>(frame.frame_id - last_.frame_id);
  const std::int64_t fresh = all - static_cast<std::int64_t>(repeats);
  const auto from_clock = [periods](std::int64_t count) { return std::abs(periods - static_cast<double>(count)); };
  const std::int64_t counted = from_clock(fresh) < from_clock(all) ? fresh : all;
  const double apart = from_clock(counted);
  const bool pause = nearest >= 1.0 && apart > kMostJitter;
  const bool chance = counted >= 1 && scatter_ > kGridTolerance && apart <= kBeyondChance * scatter_;
  const bool by_clock = !chance && (clock_fits || pause || periods < -kMostJitter);
  const std::int64_t steps = by_clock ? static_cast<std::int64_t>(nearest) : counted;
  const double off = std::abs(periods - static_cast<double>(steps));
  last_ = frame;
  if (steps >= 1 && off <= kGridTolerance) drift_ += ((periods - nearest) / nearest - drift_) / kDriftSteps;
  off_grid = off > kGridTolerance || std::abs(drift_) * kDriftSteps > kGridTolerance;
  if (steps < 1) return steps;
  count_ = std::min(count_ + 1, kScatterSteps - kSteadySteps);
  scatter_ += (std::min(off, kMostJitter) - scatter_) / (count_ + kSteadySteps);
  return steps;
}

Window::Window(const Settings& settings)
    : target_(static_cast<std::size_t>(settings.window - 1 - settings.lookahead)),
      period_s_(settings.period_s),
      places_(static_cast<std::size_t>(settings.window)),
      planes_(static_cast<std::size_t>(settings.window)) {
  released_.reserve(static_cast<std::size_t>(slots()));
}

bool Window::push(const WindowFrame& frame, bool restart) noexcept {
  released_.clear();
  incoming_ = frame;
  steps_left_ = 1;
  bool emptied = false;
  bool off_grid = false;
  const std::int64_t steps = steps_.next(frame.meta, frame.repeats, period_s_, off_grid);
  if (covered_ > 0) {
    emptied = restart || steps < 1 || steps >= static_cast<std::int64_t>(places_.size());
    if (!emptied) {
      steps_left_ = steps;
      if (off_grid) incoming_.meta.flags |= kFlagJitter;
    }
  }
  if (emptied) finish_window();
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

// Frames that wait for their look-ahead are published first, then the window is emptied.
void Window::finish_window() noexcept {
  drain_left_ = places_.size() - 1 - target_;
  if (drain_left_ == 0) clear();
}

// Advances by one period: the oldest place leaves, the newest is empty.
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
  ready.view = {planes_, static_cast<int>(target_), periods_, target.frame.meta};
  ready.full = full;
  if (!full) ready.frame.meta.flags |= kFlagWarmUp;
  if (full && gap) ready.frame.meta.flags |= kFlagGap;
  return true;
}

}  // namespace bolo::deblur

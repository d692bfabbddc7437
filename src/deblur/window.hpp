// The sliding window: places frames on the grid of frame times, leaves lost ones empty, and restarts after a break.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "src/core/frame.hpp"
#include "src/deblur/settings.hpp"
#include "src/deblur/solver.hpp"

namespace bolo::deblur {

// Periods from each frame to the next, from the camera's clock and its counter; below 1 if time does not advance. If
// they disagree, the clock is right if it shows a whole number of periods (cameras lose frames without a jump in the
// counter), or a longer pause than counter and jitter explain (NUC, reconnect: frames that never were are not counted);
// otherwise the counter is. A clock that scatters (stamps of a busy host, or in coarse steps) must differ by more than
// its scatter to be right. Frames dropped as repeats of the one before are counted or not, whichever is closer to the
// clock: those of a closed shutter take up periods, those of a camera that is read too fast do not.
class FrameSteps {
 public:
  // Since the frame of the last call; undefined for the first. `off_grid`: the clock does not show the whole number of
  // periods returned, or drifts off the grid, because the period is another one. `repeats`: frames before it that were
  // dropped as repeats. Thread: pipeline.
  std::int64_t next(const FrameMeta& frame, std::uint64_t repeats, double period_s, bool& off_grid) noexcept;

 private:
  FrameMeta last_;
  double scatter_ = 0.0;  // periods, mean distance of the clock's steps from the grid
  int count_ = 0;         // steps in the mean, up to a limit
  double drift_ = 0.0;    // periods a step, mean of the steps that fit the grid
};

// A frame in the window. `token` is the owner's handle of the plane's memory; the window never uses it.
struct WindowFrame {
  FrameMeta meta;
  const void* plane = nullptr;
  std::uint32_t token = 0;
  std::uint64_t repeats = 0;  // frames since the last one pushed that were dropped as repeats
};

// Use, all on the pipeline thread:
//   window.push(frame, restart);
//   while (window.next(ready)) { solve or copy ready; publish; }
//   for (token of window.released()) give the memory back.
// Nothing is allocated after construction.
class Window {
 public:
  // Thread: setup.
  explicit Window(const Settings& settings);

  struct Ready {
    WindowFrame frame;  // the frame to publish; meta.flags has gap and warm-up set where they apply
    WindowView view;    // valid when `full`; otherwise publish the raw plane
    bool full = false;  // a whole window lies behind this frame (and `lookahead` frames before it)
  };

  // Places a frame by its counter and its camera time (FrameSteps); flagged as jitter if it is off the grid, or if the
  // grid's period is not the clock's. With `restart`, or if the frame is further from the last one than the window is
  // long, or goes back in time, the window is emptied first; frames that still waited for their look-ahead become ready
  // without it. Returns true if the window was emptied. Thread: pipeline.
  bool push(const WindowFrame& frame, bool restart) noexcept;

  // The source's true period, for frames pushed from now on: push the next one with `restart`. Thread: pipeline.
  void set_period(double period_s) noexcept {
    period_s_ = period_s;
    steps_ = {};
  }

  // The source has ended: frames that wait for their look-ahead become ready without it. Thread: pipeline.
  void finish() noexcept;

  // The next frame to publish, oldest first; false when none is ready. Thread: pipeline.
  bool next(Ready& ready) noexcept;

  // Tokens of the planes that left the window since the last push() or finish(), complete once next() returned false;
  // valid until the next push() or finish(). Thread: pipeline.
  std::span<const std::uint32_t> released() const noexcept { return released_; }

  // The most planes held at once: the window and the incoming frame.
  int slots() const noexcept { return static_cast<int>(places_.size()) + 1; }

 private:
  struct Place {
    WindowFrame frame;
    bool taken = false;
  };

  void finish_window() noexcept;
  void advance() noexcept;
  void clear() noexcept;
  bool show_target(Ready& ready, bool full) noexcept;
  Place& place(std::size_t from_oldest) noexcept { return places_[(oldest_ + from_oldest) % places_.size()]; }

  std::size_t target_;  // the place that is estimated, counted from the oldest
  double period_s_;
  std::vector<Place> places_;  // a ring, one place a period; the oldest is places_[oldest_]
  std::size_t oldest_ = 0;
  std::uint64_t periods_ = 0;  // advanced so far, plus a whole window's at each emptying
  std::size_t covered_ = 0;    // periods since the window was emptied, at most places_.size()
  FrameSteps steps_;
  WindowFrame incoming_;
  std::int64_t steps_left_ = 0;      // until incoming_ is in the newest place
  std::size_t drain_left_ = 0;       // steps until no frame waits for its look-ahead; then the window is emptied
  std::vector<const void*> planes_;  // of Ready::view
  std::vector<std::uint32_t> released_;
};

}  // namespace bolo::deblur

// What happens to whole frames and to single pixels: found before anything is fitted, so that it does not disturb.
#pragma once

#include <cstddef>
#include <optional>
#include <vector>

#include "src/diagnose/session.hpp"

namespace bolo::diagnose {

struct Freeze {  // frames [first, last] repeat the one before
  std::size_t recording = 0;
  std::size_t first = 0;
  std::size_t last = 0;
};

// A step of the offset at one frame: global, or of each pixel.
struct Jump {
  std::size_t recording = 0;
  std::size_t frame = 0;  // the first one after it
  double global_k = 0.0;
  double pixel_k = 0.0;  // rms over the pixels about the global step, 0: all the same
  bool after_freeze = false;
  bool removed = false;  // global_k is what was taken out, not the first guess
};

struct BadPixels {
  std::vector<int> stuck;  // of the frame, row-major
  std::vector<int> noisy;
  std::vector<int> jumping;  // of the grid: between two levels
  double step_k = 0.0;       // of the jumping ones, median
};

inline constexpr std::size_t kFreezeFrames = 12;  // shorter runs are repeated frames

// Runs of identical frames: the long ones; short ones are counted in `repeated`. Marks all but the first of each run as
// not used.
std::vector<Freeze> find_freezes(Session& session, std::vector<std::size_t>& repeated_frames);

// Stuck and noisy pixels of the whole frame; then, once jumps have been taken out, those that jump between two levels.
// Marked in session.good.
BadPixels find_dead_pixels(Session& session);
void find_jumping_pixels(Session& session, BadPixels& bad);

// The clearest step in a series of residuals (frames x pixels of the grid, K): of a uniform recording its own values
// will do.
std::optional<Jump> find_jump(const Session& session, std::size_t recording, const Series& residual,
                              const std::vector<Freeze>& freezes);

// Takes a jump out of the recording's values, with the step of every pixel estimated from `residual` (all pixels of the
// grid).
void remove_jump(Session& session, Jump& jump, const Series& residual);

// The common step of all values of the recordings.
double find_step(const Session& session);

// Level at which values pile up at the top of a recording's range; infinity: none.
double find_ceiling(const Recording& recording, double level_step);

// What a recording tells without a model of what it looks at, from single pixels and whole frames alone: jumps,
// freezes, flicker, noise, patterns and outlier pixels. Thread: any.
Observation observe(const Recording& recording);

}  // namespace bolo::diagnose

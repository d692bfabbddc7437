// The sliding window: places frames on the grid of frame times, leaves lost ones empty, and starts again after a break.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "bolo/core/frame.hpp"
#include "bolo/deblur/settings.hpp"
#include "bolo/deblur/solver.hpp"

namespace bolo::deblur {

// A frame in the window. `token` is the owner's handle of the plane's memory; the window never looks at it.
struct WindowFrame {
  FrameMeta meta;
  const void* plane = nullptr;
  std::uint32_t token = 0;
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
    WindowFrame frame;  // the frame to publish; meta.flags has gap and warm-up set as they apply
    WindowView view;    // valid when `full`; otherwise publish the raw plane
    bool full = false;  // a whole window lies behind (and `lookahead` frames before) this frame
  };

  // Places a frame by its counter and its camera time. With `restart`, or when the frame is further from the last one
  // than the window is long, or goes back in time, the window is emptied first; frames that still waited for their
  // look-ahead become ready without it. Returns true when the window was emptied. Thread: pipeline.
  bool push(const WindowFrame& frame, bool restart) noexcept;

  // The source has ended: frames that wait for their look-ahead become ready without it. Thread: pipeline.
  void finish() noexcept;

  // The next frame to publish, oldest first; false when none is ready. Thread: pipeline.
  bool next(Ready& ready) noexcept;

  // Memory no longer needed since the last call; valid until the next push(). Thread: pipeline.
  std::span<const std::uint32_t> released() noexcept;

  // The most planes it ever holds at once.
  int slots() const noexcept;
};

}  // namespace bolo::deblur

// Frames deblurred one after the other in the caller's own thread: what a filter of another program's pipeline needs,
// and bit for bit what the daemon and `bolo deblur` make of the same frames.
#pragma once

#include <cstdint>
#include <memory>
#include <vector>

#include "src/core/plane.hpp"
#include "src/core/result.hpp"
#include "src/deblur/solver.hpp"
#include "src/deblur/window.hpp"
#include "src/rt/worker_team.hpp"

namespace bolo::tools {

// Use: fill(borrow()); push(time); while (next(ready)) ready is solved. Thread: any one at a time.
class StreamDeblur {
 public:
  // `format`: uint16. Errors: settings that cannot be (kBadInput).
  static Result<std::unique_ptr<StreamDeblur>> create(const deblur::Settings& settings, const StreamFormat& format,
                                                      int workers);

  // Where the next frame's plane goes, row-major without padding.
  std::uint16_t* borrow() noexcept { return plane_of(free_.back()); }
  // The frame that was filled in, taken at `time_ns`; a jump in time is frames lost. `restart`: it does not go on from
  // those before.
  void push(std::int64_t time_ns, bool restart) noexcept;
  // No more frames: those that wait for their look-ahead become ready without it.
  void finish() noexcept;

  struct Ready {
    std::int64_t time_ns = 0;  // as it was pushed
    bool full = false;         // a whole window: it is sharp; else the frame as it came
  };
  // The next frame, oldest first, into `out`, of format.geometry.pixels() values.
  bool next(Ready& ready, std::uint16_t* out) noexcept;

 private:
  StreamDeblur(const deblur::Settings& settings, const StreamFormat& format, int workers,
               std::unique_ptr<deblur::Solver> solver);
  std::uint16_t* plane_of(std::uint32_t slot) noexcept { return planes_.data() + slot * format_.geometry.pixels(); }
  void solve(const deblur::WindowView& view, std::uint16_t* out) noexcept;

  StreamFormat format_;
  double period_s_;
  deblur::Window window_;
  std::unique_ptr<deblur::Solver> solver_;
  rt::WorkerTeam team_;
  std::vector<std::uint16_t> planes_;
  std::vector<std::uint32_t> free_;
  FrameMeta last_;
  bool any_ = false;
  bool collected_ = true;  // the planes that left the window are free again
};

}  // namespace bolo::tools

// Solves single pixels of a live stream on demand, from the raw planes in shared memory, in the reader's own process:
// bit for bit as the writer's deblurred plane. For pixels with time constants of their own, whose correction depends on
// all past frames, the reader begins a window earlier, and may differ by a count.
#pragma once

#include <cstdint>
#include <memory>
#include <span>
#include <vector>

#include "drivers/shm/shm_reader.hpp"
#include "src/core/result.hpp"
#include "src/model/camera_profile.hpp"

namespace bolo::shm {

class PointReader {
 public:
  // Makes a solver with the writer's settings and instruction set for `pixels`, row-major indices. A stream whose
  // pixels have parameters of their own needs the writer's `maps`; without them, and without published settings, it is
  // refused. Thread: setup.
  static Result<PointReader> over(ShmReader reader, std::vector<std::uint32_t> pixels,
                                  const model::PixelMaps& maps = {});
  PointReader(PointReader&&) noexcept;
  PointReader& operator=(PointReader&&) noexcept;
  ~PointReader();

  enum class Outcome {
    kSolved,       // `out` holds the estimates
    kNotYet,       // the frame, or its look-ahead, is not published
    kWarmUp,       // the writer had no full window for it either
    kOverwritten,  // a frame of its window has left the ring
  };
  // Estimates the pixels of frame `number` (publication order) into `out`, pixels.size() values in the stream's scale.
  // Only the samples of these pixels are copied, but the whole raw planes where the method uses a pixel's surroundings
  // (mmae, motion, automatic lambda) or has maps. While the writer measures the noise, these also make their solver
  // anew for each frame: tens of milliseconds. Thread: one at a time.
  Outcome solve(std::uint64_t number, std::span<std::uint16_t> out);

  // That it solves with: the writer's as over() found it. Once ShmReader::frame_period_s() is another one, later frames
  // need a new reader. Thread: any.
  double period_s() const noexcept;

  // Frames published so far; the last `look-ahead` of them can't be solved yet. Thread: any.
  std::uint64_t published() const noexcept;

 private:
  struct Impl;
  explicit PointReader(std::unique_ptr<Impl> impl);
  std::unique_ptr<Impl> impl_;
};

}  // namespace bolo::shm

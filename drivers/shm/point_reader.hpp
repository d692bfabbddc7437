// Solves single pixels of a live stream on demand in the reader's process, from the raw planes in shared memory,
// bit-identical to the writer's deblurred plane. Exception: with per-pixel time constants the correction depends on all
// past frames; the reader starts one window earlier and may differ by a count.
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
  // Creates a solver for `pixels` (row-major indices) with the writer's settings and instruction set. A stream with
  // per-pixel parameters needs the writer's `maps`; refused without them, or without published settings. Thread: setup.
  static Result<PointReader> over(ShmReader reader, std::vector<std::uint32_t> pixels,
                                  const model::PixelMaps& maps = {});
  PointReader(PointReader&&) noexcept;
  PointReader& operator=(PointReader&&) noexcept;
  ~PointReader();

  enum class Outcome {
    kSolved,       // `out` holds the estimates
    kNotYet,       // the frame, or its look-ahead, is not published
    kWarmUp,       // the writer had no full window for it, either
    kOverwritten,  // a frame of its window was overwritten
  };
  // Estimates the pixels of frame `number` (publication order) into `out`, pixels.size() values in the stream's scale.
  // Copies only these samples, or whole planes if the method uses neighbours (mmae, motion, automatic lambda) or maps;
  // these also rebuild their solver per frame (tens of ms) while the writer measures the noise. Thread: one at a time.
  Outcome solve(std::uint64_t number, std::span<std::uint16_t> out);

  // The solver's frame period, as of over(). If ShmReader::frame_period_s() changes, make a new reader. Thread: any.
  double period_s() const noexcept;

  // Frames published so far; the last `look-ahead` of them can't be solved yet. Thread: any.
  std::uint64_t published() const noexcept;

 private:
  struct Impl;
  explicit PointReader(std::unique_ptr<Impl> impl);
  std::unique_ptr<Impl> impl_;
};

}  // namespace bolo::shm

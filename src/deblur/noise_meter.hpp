// The temporal noise of a stream, measured while the scene moves.
#pragma once

#include <vector>

#include "src/core/crew.hpp"
#include "src/deblur/grid.hpp"
#include "src/deblur/settings.hpp"

namespace bolo::deblur {

// The sixth difference in time of a pixel's samples has 924 times the variance of their noise and next to none of a
// scene that is smooth over seven frames. Of its mean square over blocks of 4 x 8 pixels the 5 % quantile is taken: the
// calmest places of the frame, corrected for what the quantile of pure noise would be. Where everything moves even
// those overestimate, so the measure falls within a few frames and rises by 0.2 % a frame at most.
class NoiseMeter {
 public:
  // Thread: setup.
  explicit NoiseMeter(const StreamTask& task);

  // Measures the newest frames of a window. No allocation. Thread: pipeline.
  void update(const WindowView& window, const Pattern& pattern, Crew& crew) noexcept;

  // Standard deviation in the values' unit: the settings' if they give one, else the measured, at least that of
  // quantisation. Thread: pipeline.
  double noise() const noexcept;

 private:
  double measure(const void* const* planes, int order, Crew& crew) noexcept;

  StreamTask task_;
  double floor_;
  double given_;
  double measured_ = 0.0;      // 0: nothing yet
  std::vector<float> column_;  // sums of each strip of rows
  std::vector<float> block_;
};

}  // namespace bolo::deblur

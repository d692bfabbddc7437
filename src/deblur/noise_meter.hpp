// The temporal noise of a stream, measured while the scene moves.
#pragma once

#include <limits>
#include <vector>

#include "src/core/crew.hpp"
#include "src/deblur/grid.hpp"
#include "src/deblur/settings.hpp"

namespace bolo::deblur {

// Standard deviation of a uint16 stream's rounding, or 1 mK, in the values' unit.
double least_noise(const StreamFormat& input);

// The sixth difference in time of a pixel's samples has 924 times the variance of their noise, and next to none of a
// scene that is smooth over seven frames. Of its mean square over blocks of 4 x 8 pixels the 5 % quantile is taken: the
// calmest places of the frame, corrected for the quantile's value for pure noise. Where everything moves even those
// overestimate, so the measure falls within a few frames and rises by at most 0.2 % a frame. Blocks that contain the
// frame's lowest or highest value are left out: clipping at the end of a camera's range reduces or removes noise.
class NoiseMeter {
 public:
  struct Ends {  // lowest and highest value
    float low = std::numeric_limits<float>::infinity();
    float high = -std::numeric_limits<float>::infinity();
  };

  // Thread: setup.
  explicit NoiseMeter(const StreamTask& task);

  // Measures the newest frames of a window. No allocation. Thread: pipeline.
  void update(const WindowView& window, const Pattern& pattern, Crew& crew) noexcept;

  // Standard deviation, values' unit: as set, or measured, at least that of quantisation. Thread: pipeline.
  double noise() const noexcept;

  // Like the settings' noise_k; 0: measured. Thread: pipeline.
  void set(double noise_k) noexcept;

  // The measured noise, whatever the settings say; 0 before the first measurement. Thread: pipeline.
  double measured() const noexcept { return measured_; }

 private:
  double measure(const void* const* planes, int order, Crew& crew) noexcept;
  double calmest(const void* const* planes, int order, bool without_ends, Crew& crew) noexcept;
  void leave_out_ends(const void* oldest, const void* newest, int rows, int strips, Crew& crew) noexcept;

  StreamTask task_;
  double floor_;
  double given_ = 0.0;
  double measured_ = 0.0;      // 0: nothing yet
  std::vector<float> column_;  // sums of each strip of rows
  std::vector<float> block_;
  std::vector<Ends> ends_;  // of each strip
};

}  // namespace bolo::deblur

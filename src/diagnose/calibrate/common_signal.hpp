// What the pixels of a recording have in common: which of them see the same pulses, and their mean.
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "src/diagnose/calibrate.hpp"

namespace bolo::diagnose {

struct CommonSignal {
  std::vector<double> shape;         // one value a frame, mean 0, variance 1
  std::vector<std::int8_t> follows;  // of each pixel of the frame: 1, or -1 where it is upside down, 0: does not follow
  std::vector<double> mean;          // one value a frame: the mean of the pixels that follow (signs taken out)
  std::vector<float> deviation;      // of each pixel: rms about its own mean
  std::size_t pixels = 0;            // that follow
  double clipped_share = 0.0;  // of the values of pixels that follow: at the end of 16 bits, or piled up at one level
};

// The strongest common shape on a grid of pixels, each scaled to its own deviation so that no single one rules (power
// iteration), then every pixel of the frame by its correlation with it. kBadInput when nothing is in common, or frames
// have values that are no numbers. Thread: setup.
Result<CommonSignal> find_common_signal(const FrameSeries& frames, const Progress& progress);

inline constexpr double kLeastCorrelation = 0.5;

}  // namespace bolo::diagnose

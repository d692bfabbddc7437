// From kelvin to what a network takes.
#pragma once

#include <span>
#include <vector>

#include "src/core/geometry.hpp"
#include "tools/lab/detect/box.hpp"
#include "tools/lab/detect/description.hpp"
#include "tools/lab/detect/tensor.hpp"

namespace bolo::tools::detect {

// Row-major grey levels, whole numbers from 0 to 255.
using Levels = std::vector<float>;

// Black at cold_k and white at hot_k, rounded and clamped: what a video of 8 bits would show. Thread: any.
Levels levels_of(std::span<const float> kelvin, double cold_k, double hot_k);

// Where a picture lies in a network's input: input = scale * picture + offset, in pixels, edges at whole numbers.
struct Fit {
  double scale_x = 1.0;
  double scale_y = 1.0;
  double left = 0.0;
  double top = 0.0;

  Box to_picture(const Box& in_input) const;
};

// Thread: any.
Fit fit_of(Geometry picture, Geometry input, Resize resize);

// The input {1, 3, height, width} that a description asks for: bilinear between the centres of pixels,
// (as OpenCV's INTER_LINEAR); grey around a letterboxed picture. Thread: any.
Tensor input_of(const Levels& levels, Geometry picture, const DetectorDescription& description);

}  // namespace bolo::tools::detect

// Values of a picture between its pixels.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <span>

#include "src/core/geometry.hpp"

namespace bolo::tools {

// Bicubic (Catmull and Rom); beyond the border its pixels repeat. Thread: any.
inline float sample(std::span<const float> plane, Geometry g, double x, double y) noexcept {
  const auto weights = [](double f) {
    return std::array{((2.0 - f) * f - 1.0) * f / 2.0, ((3.0 * f - 5.0) * f * f + 2.0) / 2.0,
                      ((4.0 - 3.0 * f) * f + 1.0) * f / 2.0, (f - 1.0) * f * f / 2.0};
  };
  const double left = std::floor(x);
  const double top = std::floor(y);
  const auto wx = weights(x - left);
  const auto wy = weights(y - top);
  double sum = 0.0;
  for (std::size_t j = 0; j < wy.size(); ++j) {
    const auto row = static_cast<std::size_t>(std::clamp(top - 1.0 + static_cast<double>(j), 0.0, g.height - 1.0));
    const float* from = plane.data() + row * static_cast<std::size_t>(g.width);
    for (std::size_t i = 0; i < wx.size(); ++i) {
      const double column = std::clamp(left - 1.0 + static_cast<double>(i), 0.0, g.width - 1.0);
      sum += wy[j] * wx[i] * static_cast<double>(from[static_cast<std::size_t>(column)]);
    }
  }
  return static_cast<float>(sum);
}

}  // namespace bolo::tools

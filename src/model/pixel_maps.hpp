// Maps of single pixels and rows of one camera.
#pragma once

#include <cstdint>
#include <vector>

#include "src/core/geometry.hpp"

namespace bolo::model {

// Maps are row-major over the whole frame; an empty one means the nominal value everywhere. Corrections apply in this
// order: value -> gain * value + offset -> thermal inertia with the pixel's own tau_s. "Value" is a temperature in K,
// or counts for frames that have no kelvin.
struct PixelMaps {
  Geometry geometry;               // of the frames that the maps are for; 0x0: of the stream they are used with
  std::vector<float> tau_s;        // thermal time constant, s
  std::vector<float> gain;         // 1: as the camera says
  std::vector<float> offset;       // in the unit of the frames: K, or counts where they have no kelvin
  std::vector<std::uint8_t> dead;  // 1: the pixel says nothing; it is filled from its neighbours
  double row_delay_s = 0.0;        // sensor row r is sampled r * row_delay_s after the frame's time; s

  bool empty() const { return tau_s.empty() && gain.empty() && offset.empty() && dead.empty() && row_delay_s == 0.0; }
};

}  // namespace bolo::model

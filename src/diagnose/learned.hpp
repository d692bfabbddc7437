// What a diagnosis has learned of a camera, in the terms of the pipeline that undoes it.
#pragma once

#include "src/model/camera_profile.hpp"
#include "src/model/pixel_maps.hpp"

namespace bolo::diagnose {

struct Learned {
  // The profile that the diagnosis began with, and what was found of the camera as a whole. `maps` in it is as before.
  model::CameraProfile profile;
  // What undoes the rest, of the full frame, when Options::maps asked for it: the camera shows
  // (1 + g) T - g 300 K + o of a temperature T, so gain = 1 / (1 + g) and offset = (300 K g - o) / (1 + g). An empty
  // map: nothing of its kind was found. row_delay_s is the profile's.
  model::PixelMaps maps;
};

}  // namespace bolo::diagnose

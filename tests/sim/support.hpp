#pragma once

#include "src/sim/simulator.hpp"
#include "tests/refusal.hpp"
#include "tests/scratch.hpp"

namespace bolo::sim::testing {

// A camera without noise or quantisation, so that the physics can be compared exactly.
inline CameraSettings ideal_camera(Geometry geometry) {
  CameraSettings camera;
  camera.geometry = geometry;
  camera.readout.noise_k = 0.0;
  camera.readout.quantisation_k = 0.0;
  camera.readout.type = PixelType::kFloat32;
  return camera;
}

struct Frames {
  std::vector<std::vector<float>> shown;
  std::vector<std::vector<float>> truth;
};

inline Frames run(const CameraSettings& camera, std::unique_ptr<const Field> field, std::size_t frames) {
  auto simulator = must(Simulator::create(camera, std::move(field)));
  Frames result;
  for (std::size_t k = 0; simulator && k < frames; ++k) {
    result.shown.emplace_back(camera.geometry.pixels());
    result.truth.emplace_back(camera.geometry.pixels());
    (*simulator)->next(result.shown.back().data(), result.truth.back().data());
  }
  return result;
}

// An image with the value column(x) in every row.
template <typename Column>
capture::StillImage columns(int width, int height, Column column) {
  capture::StillImage image{width, height, {}};
  for (int y = 0; y < height; ++y) {
    for (int x = 0; x < width; ++x) image.kelvin.push_back(static_cast<float>(column(x)));
  }
  return image;
}

}  // namespace bolo::sim::testing

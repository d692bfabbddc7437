// Small captures, and a folder to put them in.
#pragma once

#include <gtest/gtest.h>

#include <cstdint>
#include <cstdlib>
#include <filesystem>
#include <string>
#include <vector>

#include "src/capture/capture.hpp"
#include "tests/scratch.hpp"

namespace bolo::capture::testing {

inline CaptureInfo small_info(PixelType type = PixelType::kUint16) {
  CaptureInfo info;
  info.format.geometry = {7, 3};
  info.format.type = type;
  info.format.scale = {Unit::kKelvin, 0.01, 1.5};
  info.format.frame_period_s = 0.005;
  info.format.row_step = 4;
  info.camera_model = "FLIR A655sc";
  info.camera_serial = "55001234";
  return info;
}

// A value that tells frame and pixel apart and fits every type exactly.
inline std::uint16_t value_at(std::size_t frame, std::size_t pixel) {
  return static_cast<std::uint16_t>(1000 + 100 * frame + pixel);
}

template <typename T>
std::vector<T> plane_of(std::size_t frame, std::size_t pixels) {
  std::vector<T> plane(pixels);
  for (std::size_t i = 0; i < pixels; ++i) plane[i] = static_cast<T>(value_at(frame, i));
  return plane;
}

}  // namespace bolo::capture::testing

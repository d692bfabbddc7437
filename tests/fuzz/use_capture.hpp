// Uses everything of a capture: for targets that read such files.
#pragma once

#include <algorithm>
#include <cstddef>
#include <vector>

#include "src/capture/capture.hpp"

namespace bolo::fuzz {

inline void use_capture(const capture::CaptureReader& reader) {
  constexpr std::size_t kMostFrames = 8;
  constexpr std::size_t kMostPixels = 1 << 20;
  static_cast<void>(reader.attributes());
  static_cast<void>(reader.stimulus());
  static_cast<void>(reader.points());
  const capture::CaptureInfo& info = reader.info();
  if (info.format.geometry.pixels() > kMostPixels) return;  // valid, but too slow
  std::vector<std::byte> plane(plane_bytes(info.format.geometry, info.format.type));
  std::vector<float> truth(info.format.geometry.pixels());
  for (std::size_t i = 0; i < std::min(info.frames, kMostFrames); ++i) {
    static_cast<void>(reader.read_frame(i, plane.data()));
    if (info.has_truth) static_cast<void>(reader.read_truth(i, truth.data()));
  }
}

}  // namespace bolo::fuzz

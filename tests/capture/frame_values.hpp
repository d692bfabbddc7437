#pragma once

#include "src/capture/capture.hpp"
#include "tests/test.hpp"

namespace bolo::capture::testing {

// A frame of a capture, as it is stored: std::uint16_t or float.
template <typename T = std::uint16_t>
std::vector<T> frame_values(const CaptureReader& reader, std::size_t frame) {
  std::vector<T> plane(reader.info().format.geometry.pixels());
  must(reader.read_frame(frame, plane.data()));
  return plane;
}

}  // namespace bolo::capture::testing

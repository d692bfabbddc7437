// A frame's values without their storage: what kernels read and sinks copy.
#pragma once

#include <cstddef>
#include <cstdint>

#include "src/core/geometry.hpp"

namespace bolo {

enum class PixelType {
  kUint16,   // cameras and shared memory
  kFloat32,  // captures converted to kelvin, and offline results
};

// Bytes of one value. Thread: any.
constexpr std::size_t bytes_of(PixelType type) { return type == PixelType::kUint16 ? 2 : 4; }

// Bytes of one whole plane. Thread: any.
constexpr std::size_t plane_bytes(Geometry g, PixelType type) { return g.pixels() * bytes_of(type); }

// Format of a stream's frames; fixed from open to close.
struct StreamFormat {
  Geometry geometry;
  PixelType type = PixelType::kUint16;
  LinearScale scale;
  double frame_period_s = 0.005;
  int row_step = 1;  // sensor rows that one stored row stands for

  constexpr bool operator==(const StreamFormat&) const = default;
};

}  // namespace bolo

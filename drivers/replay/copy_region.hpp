// Part of a plane as a plane of its own.
#pragma once

#include <cstddef>
#include <cstring>

#include "src/core/geometry.hpp"

namespace bolo::replay {

// Copies `region` of a plane of geometry `whole` with values of `value_bytes` into `out`, row after row without gaps.
// The region lies inside. Thread: any.
inline void copy_region(const void* plane, Geometry whole, std::size_t value_bytes, const Region& region, void* out) {
  const std::size_t row_bytes = static_cast<std::size_t>(region.width) * value_bytes;
  const auto* from = static_cast<const std::byte*>(plane);
  auto* to = static_cast<std::byte*>(out);
  for (int y = region.y; y < region.y + region.height; ++y, to += row_bytes) {
    const auto first =
        static_cast<std::size_t>(y) * static_cast<std::size_t>(whole.width) + static_cast<std::size_t>(region.x);
    std::memcpy(to, from + first * value_bytes, row_bytes);
  }
}

}  // namespace bolo::replay

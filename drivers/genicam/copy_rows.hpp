// Pixels from a camera's buffer into a plane.
#pragma once

#include <cstddef>
#include <cstdint>

#include "drivers/genicam/genicam_source.hpp"
#include "src/core/byte_order.hpp"
#include "src/core/geometry.hpp"

namespace bolo::genicam {

// geometry.height rows whose starts lie `stride` bytes apart, in the camera's byte order, into a plane without padding
// in the host's. Rows after them in the buffer (metadata) are left out. Thread: any.
inline void copy_rows(const std::byte* from, std::size_t stride, PixelOrder order, Geometry geometry,
                      std::uint16_t* to) noexcept {
  const auto width = static_cast<std::size_t>(geometry.width);
  for (int y = 0; y < geometry.height; ++y, from += stride, to += width) {
    copy_values(from, order == PixelOrder::kBigEndian, to, width);
  }
}

// Replaces each of `count` values by its entry in a table of 65,536. Thread: any.
inline void translate(std::uint16_t* values, std::size_t count, const std::uint16_t* table) noexcept {
  for (std::size_t i = 0; i < count; ++i) values[i] = table[values[i]];
}

}  // namespace bolo::genicam

// Pixels from a camera's buffer into a plane.
#pragma once

#include <bit>
#include <cstddef>
#include <cstdint>
#include <cstring>

#include "bolo/core/geometry.hpp"
#include "drivers/genicam/genicam_source.hpp"

namespace bolo::genicam {

// One row of 16-bit values with the bytes of each exchanged. The loop becomes vector shuffles. `from` need not be
// aligned. Thread: any.
inline void copy_swapped(const std::byte* from, std::uint16_t* to, std::size_t count) noexcept {
  for (std::size_t i = 0; i < count; ++i) {
    std::uint16_t value = 0;
    std::memcpy(&value, from + 2 * i, sizeof value);
    to[i] = static_cast<std::uint16_t>((value << 8) | (value >> 8));
  }
}

// geometry.height rows whose starts lie `stride` bytes apart, in the camera's byte order, into a plane without padding
// in the host's. Rows after them in the buffer (metadata) are left out. Thread: any.
inline void copy_rows(const std::byte* from, std::size_t stride, PixelOrder order, Geometry geometry,
                      std::uint16_t* to) noexcept {
  const bool swap = (order == PixelOrder::kBigEndian) != (std::endian::native == std::endian::big);
  const auto width = static_cast<std::size_t>(geometry.width);
  for (int y = 0; y < geometry.height; ++y, from += stride, to += width) {
    if (swap) {
      copy_swapped(from, to, width);
    } else {
      std::memcpy(to, from, width * sizeof *to);
    }
  }
}

// Replaces each of `count` values by its entry in a table of 65,536. Thread: any.
inline void translate(std::uint16_t* values, std::size_t count, const std::uint16_t* table) noexcept {
  for (std::size_t i = 0; i < count; ++i) values[i] = table[values[i]];
}

}  // namespace bolo::genicam

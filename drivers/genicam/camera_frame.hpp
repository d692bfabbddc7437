// A frame as a transport (GVSP or Aravis) delivers it, and the copy of its pixels into a plane.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>

#include "drivers/genicam/genicam_source.hpp"
#include "src/core/byte_order.hpp"
#include "src/core/frame.hpp"

namespace bolo::genicam {

// The way in which a frame ended.
enum class FrameEnd {
  kWhole,
  kIncomplete,  // packets of it never came
  kDriver,      // the transport library aborted it
};

struct CameraFrame {
  // Of a frame whose number is not known, because its first packet was lost.
  static constexpr std::uint64_t kNoId = ~std::uint64_t{0};

  FrameEnd end = FrameEnd::kIncomplete;
  std::uint64_t id = kNoId;
  // The rest is of whole frames only.
  std::int64_t camera_ns = 0;   // the camera's clock, any value
  std::int64_t receive_ns = 0;  // CLOCK_MONOTONIC, when the first packet was taken from the socket
  bool mono16 = false;          // an image of 16-bit grey values, not something else
  int width = 0;
  int height = 0;
  int x_padding = 0;                    // bytes after each row
  std::span<const std::byte> pixels{};  // received so far; valid until the call that brought it returns
};

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

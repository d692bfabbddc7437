// A frame from a transport (GVSP or Aravis), and copying its pixels to a plane.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>

#include "drivers/genicam/genicam_source.hpp"
#include "src/core/byte_order.hpp"
#include "src/core/frame.hpp"

namespace bolo::genicam {

enum class FrameEnd {
  kWhole,
  kIncomplete,  // packets missing
  kDriver,      // the transport library aborted it
};

struct CameraFrame {
  // Id of a frame whose number is unknown because its first packet was lost.
  static constexpr std::uint64_t kNoId = ~std::uint64_t{0};

  FrameEnd end = FrameEnd::kIncomplete;
  std::uint64_t id = kNoId;
  // The members below are valid for complete frames only.
  std::int64_t camera_ns = 0;   // camera clock, arbitrary value
  std::int64_t receive_ns = 0;  // CLOCK_MONOTONIC when the first packet was read from the socket
  bool mono16 = false;          // a 16-bit grey image
  int width = 0;
  int height = 0;
  int x_padding = 0;                    // bytes after each row
  std::span<const std::byte> pixels{};  // received so far; valid during the call that delivers the frame
};

// Copies geometry.height rows, `stride` bytes apart and in the camera's byte order, to a plane without padding in host
// byte order. Further rows (metadata) are dropped. Thread: any.
inline void copy_rows(const std::byte* from, std::size_t stride, PixelOrder order, Geometry geometry,
                      std::uint16_t* to) noexcept {
  const auto width = static_cast<std::size_t>(geometry.width);
  for (int y = 0; y < geometry.height; ++y, from += stride, to += width) {
    copy_values(from, order == PixelOrder::kBigEndian, to, width);
  }
}

}  // namespace bolo::genicam

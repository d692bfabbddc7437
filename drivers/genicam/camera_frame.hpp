// A frame as a transport (GVSP or Aravis) delivers it.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>

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
  std::int64_t camera_ns = 0;   // the camera's clock
  std::int64_t receive_ns = 0;  // CLOCK_MONOTONIC, when the first packet was taken from the socket
  bool mono16 = false;          // an image of 16-bit grey values, not something else
  int width = 0;
  int height = 0;
  int x_padding = 0;                    // bytes after each row
  std::span<const std::byte> pixels{};  // received so far; valid until the call that brought it returns
};

}  // namespace bolo::genicam

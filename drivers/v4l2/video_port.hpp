// Interface of a video device; a test puts its own in the device's place.
#pragma once

#include <cstddef>
#include <span>
#include <string>

#include "drivers/v4l2/image.hpp"
#include "src/core/geometry.hpp"
#include "src/core/result.hpp"

namespace bolo::v4l2 {

struct VideoFormat {
  PixelFormat pixels = PixelFormat::kY16;
  Geometry geometry;
  double frame_period_s = 0.005;
};

class VideoPort {
 public:
  virtual ~VideoPort() = default;

  // Opens the device and tells it what will come. A device that is not there, or cannot take this, is bad input and
  // says how to mend it. Thread: setup, or the sink's.
  virtual Status open(const VideoFormat& format) = 0;

  // Gives it one whole image. 0: it was taken; EAGAIN: not now; any other errno: the device is of no use any more.
  // Thread: the sink's.
  virtual int write(std::span<const std::byte> image) noexcept = 0;

  // Thread: that of open() and write().
  virtual void close() noexcept = 0;

  // As the configuration names it. Thread: any.
  virtual const std::string& path() const noexcept = 0;
};

}  // namespace bolo::v4l2

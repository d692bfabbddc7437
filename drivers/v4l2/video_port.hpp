// Interface of a video device; a test puts its own in the device's place.
#pragma once

#include <cstddef>
#include <span>
#include <string>
#include <utility>

#include "drivers/v4l2/image.hpp"
#include "src/core/frame.hpp"
#include "src/core/result.hpp"
#include "src/core/unique_fd.hpp"

namespace bolo::v4l2 {

struct VideoFormat {
  PixelFormat pixels = PixelFormat::kY16;
  Geometry geometry;
  double frame_period_s = 0.005;
};

class VideoPort {
 public:
  virtual ~VideoPort() = default;

  // Opens the device and sets its format. A device that is not there, or cannot take this, is bad input, with the
  // remedy. Thread: setup, or the sink's.
  virtual Status open(const VideoFormat& format) = 0;

  // Gives it one whole image. 0: it was taken; EAGAIN: not now; any other errno: the device is of no use any more.
  // Thread: the sink's.
  virtual int write(std::span<const std::byte> image) noexcept = 0;

  // Thread: that of open() and write().
  virtual void close() noexcept = 0;

  // As the configuration names it. Thread: any.
  virtual const std::string& path() const noexcept = 0;
};

// A device of the kernel module v4l2loopback: what is written into it, video programs read as from a camera.
class LoopbackPort final : public VideoPort {
 public:
  explicit LoopbackPort(std::string path) : path_(std::move(path)) {}

  Status open(const VideoFormat& format) override;
  int write(std::span<const std::byte> image) noexcept override;
  void close() noexcept override { fd_ = UniqueFd(); }
  const std::string& path() const noexcept override { return path_; }

 private:
  Status check_driver() const;
  Status set_format(const VideoFormat& format) const;
  Status become_writer() const;

  std::string path_;
  UniqueFd fd_;
};

}  // namespace bolo::v4l2

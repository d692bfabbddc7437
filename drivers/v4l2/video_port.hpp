// Interface of a video device; tests implement their own.
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

  // Opens the device, sets its format. kBadInput: missing or unsuitable, with the remedy. Thread: setup, or the sink's.
  virtual Status open(const VideoFormat& format) = 0;

  // Writes one whole image. 0: accepted; EAGAIN: busy; any other errno: the device is unusable. Thread: the sink's.
  virtual int write(std::span<const std::byte> image) noexcept = 0;

  // Thread: that of open() and write().
  virtual void close() noexcept = 0;

  // As named in the configuration. Thread: any.
  virtual const std::string& path() const noexcept = 0;
};

// A device of the kernel module v4l2loopback: video programs read what is written to it as from a camera.
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

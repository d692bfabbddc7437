// One opening of a video device, from discovery to the last buffer.
#pragma once

#include <linux/videodev2.h>

#include <memory>
#include <span>
#include <string>
#include <vector>

#include "drivers/v4l2_source/v4l2_source.hpp"
#include "src/core/frame.hpp"
#include "src/core/result.hpp"

namespace bolo::v4l2_source {

// A frame of the driver; its bytes belong to the device until give_back().
struct VideoFrame {
  v4l2_buffer buffer{};
  std::span<const std::byte> bytes;
};

class VideoDevice {
 public:
  // Finds the device named in the options, requests its format and buffers; streaming is not started. `serial`: of the
  // required camera, at any node; empty: any. Errors (kBadInput) include the remedy. Thread: setup, or acquire.
  static Result<std::unique_ptr<VideoDevice>> open(VideoSystem& system, const V4l2SourceOptions& options,
                                                   const std::string& serial);
  ~VideoDevice();
  VideoDevice(const VideoDevice&) = delete;
  VideoDevice& operator=(const VideoDevice&) = delete;

  // Starts streaming. Thread: acquire.
  Status start();

  // False: another program has changed the format, and frames of as many bytes are another picture. Thread: acquire.
  bool has_its_format() noexcept;

  // 1: a frame is ready, or the device is gone. 0: timeout. Thread: acquire.
  int wait(int timeout_ms) noexcept { return system_.poll(fd_, timeout_ms); }
  // 0: `frame` is the next one. EAGAIN: none ready. Any other errno: a device error. Thread: acquire.
  int take(VideoFrame& frame) noexcept;
  // Thread: acquire.
  void give_back(VideoFrame& frame) noexcept { system_.ioctl(fd_, VIDIOC_QBUF, &frame.buffer); }

  const std::string& path() const noexcept { return path_; }
  const std::string& serial() const noexcept { return serial_; }
  const std::string& model() const noexcept { return model_; }
  // Whole frames of the device, including metadata and stacked images.
  Geometry geometry() const noexcept { return geometry_; }
  std::size_t stride() const noexcept { return stride_; }  // bytes per row
  double period_s() const noexcept { return period_s_; }   // 0: unknown to the driver
  // True for the byte count of a complete frame.
  bool is_whole(std::size_t bytes) const noexcept {
    return bytes == stride_ * static_cast<std::size_t>(geometry_.height) || bytes == image_bytes_;
  }

 private:
  struct Buffer {
    void* memory = nullptr;
    std::size_t bytes = 0;
  };
  VideoDevice(VideoSystem& system, int fd, std::string path, std::string serial)
      : system_(system), fd_(fd), path_(std::move(path)), serial_(std::move(serial)) {}

  Status check_capabilities();
  Status agree_on_format(std::uint32_t wanted);
  void query_period();
  Status request_buffers(int count);
  std::string offered();
  tl::unexpected<Error> refused(const std::string& what) const;

  VideoSystem& system_;
  int fd_;
  std::string path_;
  std::string serial_;
  std::string model_;
  std::uint32_t code_ = 0;
  Geometry geometry_;
  std::size_t stride_ = 0;
  std::size_t image_bytes_ = 0;
  double period_s_ = 0.0;
  bool streaming_ = false;
  std::vector<Buffer> buffers_;
};

}  // namespace bolo::v4l2_source

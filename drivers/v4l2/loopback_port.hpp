// A device of the kernel module v4l2loopback: what is written into it, video programs read as from a camera.
#pragma once

#include <string>
#include <utility>

#include "drivers/v4l2/video_port.hpp"
#include "src/core/unique_fd.hpp"

namespace bolo::v4l2 {

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

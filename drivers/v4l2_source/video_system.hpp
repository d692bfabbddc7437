// System calls on video devices; tests substitute a fake device.
#pragma once

#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

namespace bolo::v4l2_source {

// A video device present now. serial: of its USB device; empty: none.
struct VideoNode {
  std::string path;
  std::string serial;
};

// Each behaves like the system call of its name: -1 and errno on failure.
class VideoSystem {
 public:
  virtual ~VideoSystem() = default;

  // Thread: setup, or acquire.
  virtual int open(const char* path) noexcept = 0;
  virtual void close(int fd) noexcept = 0;
  virtual void* map(int fd, std::size_t bytes, std::int64_t offset) noexcept = 0;  // null on failure
  virtual void unmap(void* memory, std::size_t bytes) noexcept = 0;
  // Capture devices and others, from sysfs.
  virtual std::vector<VideoNode> nodes() = 0;

  // Never blocks, because devices are opened with O_NONBLOCK. Thread: setup, or acquire.
  virtual int ioctl(int fd, unsigned long request, void* argument) noexcept = 0;
  // 1: a frame is ready, or the device is gone, which the next ioctl reports. 0: timeout.
  virtual int poll(int fd, int timeout_ms) noexcept = 0;
};

// The kernel's; lives until the program ends. Thread: any.
VideoSystem& kernel_video();

}  // namespace bolo::v4l2_source

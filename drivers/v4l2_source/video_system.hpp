// The system calls that a video device is driven by; a test puts a device of its own behind them.
#pragma once

#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

namespace bolo::v4l2_source {

// A video device that is there now. serial: that of its USB device; empty: it has none.
struct VideoNode {
  std::string path;
  std::string serial;
};

// Each as the system call of its name: -1 and errno on failure.
class VideoSystem {
 public:
  virtual ~VideoSystem() = default;

  // Thread: setup, or acquire.
  virtual int open(const char* path) noexcept = 0;
  virtual void close(int fd) noexcept = 0;
  virtual void* map(int fd, std::size_t bytes, std::int64_t offset) noexcept = 0;  // null on failure
  virtual void unmap(void* memory, std::size_t bytes) noexcept = 0;
  // Capture devices and others, by sysfs.
  virtual std::vector<VideoNode> nodes() = 0;

  // Never blocks: devices are opened so. Thread: setup, or acquire.
  virtual int ioctl(int fd, unsigned long request, void* argument) noexcept = 0;
  // 1: a frame waits, or the device is gone, which the next ioctl reports. 0: neither in time.
  virtual int poll(int fd, int timeout_ms) noexcept = 0;
};

// The kernel's. Lives for ever. Thread: any.
VideoSystem& kernel_video();

}  // namespace bolo::v4l2_source

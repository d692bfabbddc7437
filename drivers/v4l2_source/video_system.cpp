#include "drivers/v4l2_source/video_system.hpp"

#include <fcntl.h>
#include <poll.h>
#include <sys/ioctl.h>
#include <sys/mman.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <filesystem>

#include "src/core/input_file.hpp"

namespace bolo::v4l2_source {
namespace {

namespace fs = std::filesystem;

// Serial number of the nearest ancestor device that has one: for USB cameras, the USB device that owns this interface.
std::string serial_of(const fs::path& node) {
  std::error_code error;
  fs::path device = fs::canonical(node / "device", error);
  for (int up = 0; !error && up < 3 && device.has_relative_path(); ++up, device = device.parent_path()) {
    if (std::string serial = first_line(device / "serial"); !serial.empty()) return serial;
  }
  return {};
}

class KernelVideo final : public VideoSystem {
 public:
  int open(const char* path) noexcept override { return ::open(path, O_RDWR | O_NONBLOCK | O_CLOEXEC); }
  void close(int fd) noexcept override { ::close(fd); }
  void* map(int fd, std::size_t bytes, std::int64_t offset) noexcept override {
    void* const memory = mmap(nullptr, bytes, PROT_READ | PROT_WRITE, MAP_SHARED, fd, offset);
    return memory == MAP_FAILED ? nullptr : memory;
  }
  void unmap(void* memory, std::size_t bytes) noexcept override { munmap(memory, bytes); }

  std::vector<VideoNode> nodes() override {
    std::vector<VideoNode> found;
    std::error_code error;
    for (fs::directory_iterator at("/sys/class/video4linux", error), end; !error && at != end; at.increment(error)) {
      const std::string name = at->path().filename();
      if (name.starts_with("video")) found.push_back({"/dev/" + name, serial_of(at->path())});
    }
    std::sort(found.begin(), found.end(), [](const auto& a, const auto& b) { return a.path < b.path; });
    return found;
  }

  int ioctl(int fd, unsigned long request, void* argument) noexcept override {
    int result = 0;
    do {
      result = ::ioctl(fd, request, argument);
    } while (result < 0 && errno == EINTR);
    return result;
  }
  int poll(int fd, int timeout_ms) noexcept override {
    pollfd device{fd, POLLIN, 0};
    const int ready = ::poll(&device, 1, timeout_ms);
    return ready < 0 && errno == EINTR ? 0 : ready;
  }
};

}  // namespace

VideoSystem& kernel_video() {
  static KernelVideo kernel;
  return kernel;
}

}  // namespace bolo::v4l2_source

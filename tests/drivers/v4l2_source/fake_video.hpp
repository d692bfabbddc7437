// Fake video devices behind the system calls, controlled by the test.
#pragma once

#include <linux/videodev2.h>

#include "drivers/v4l2_source/video_system.hpp"
#include "src/core/clock.hpp"
#include "tests/test.hpp"

namespace bolo::v4l2_source::test {

// A device. Tests change it under FakeVideo::change().
struct FakeCamera {
  std::string serial = "A1";
  std::string card = "Boson";
  std::uint32_t capabilities = V4L2_CAP_VIDEO_CAPTURE | V4L2_CAP_STREAMING;
  std::vector<std::uint32_t> formats{V4L2_PIX_FMT_Y16};
  std::uint32_t code = V4L2_PIX_FMT_Y16;  // current
  std::uint32_t width = 8;
  std::uint32_t height = 6;
  std::uint32_t padding = 0;  // bytes behind each row
  std::uint32_t missing = 0;  // bytes missing at the end of an image
  v4l2_fract period{1, 60};   // 0/0: unknown
  bool there = true;
  int busy = 0;  // errno of S_FMT and REQBUFS
  std::uint32_t stamps = V4L2_BUF_FLAG_TIMESTAMP_MONOTONIC | V4L2_BUF_FLAG_TSTAMP_SRC_SOE;
  int open_refused = 0;          // errno
  int take_refused = 0;          // errno of DQBUF although poll reports a frame
  bool endless = false;          // always one more frame, of a few bytes
  bool no_end_of_lists = false;  // endless lists of formats and buffers

  std::uint32_t sequence = 0;  // of the next frame
  int opened = 0;              // number of opens
  int refusals = 0;            // of DQBUF
  bool streaming = false;
  std::vector<std::vector<std::byte>> memory{};  // of the buffers
  std::deque<std::uint32_t> queued{};
  std::deque<v4l2_buffer> done{};

  std::size_t stride() const { return 2 * width + padding; }
  std::size_t bytes() const { return stride() * height - missing; }
};

struct Sent {
  std::uint32_t flags = 0;
  std::int64_t stamp_ns = 0;  // 0: now
  std::size_t bytes = 0;      // 0: all
  int skip = 0;               // skipped sequence numbers before it
  bool counts = true;         // the driver's counter advances
};

class FakeVideo final : public VideoSystem {
 public:
  // Changes a device under the lock: the source's threads read it meanwhile.
  template <typename Change>
  auto change(const Change& with) {
    const std::lock_guard lock(mutex_);
    changed_.notify_all();
    return with(cameras_);
  }
  FakeCamera& add(const std::string& path) { return cameras_[path]; }

  // Sends a frame of values first, first + 1, ... False: no free buffer or not streaming; the frame is lost, as in the
  // kernel.
  bool send(const std::string& path, std::uint16_t first, const Sent& how = {}) {
    const std::lock_guard lock(mutex_);
    FakeCamera& camera = cameras_.at(path);
    camera.sequence += static_cast<std::uint32_t>(how.skip);
    const std::uint32_t number = camera.sequence;
    if (how.counts) ++camera.sequence;
    if (!camera.there || !camera.streaming || camera.queued.empty()) return false;
    v4l2_buffer buffer{};
    buffer.index = camera.queued.front();
    camera.queued.pop_front();
    std::vector<std::byte>& memory = camera.memory[buffer.index];
    for (std::size_t y = 0; y < camera.height; ++y) {
      for (std::size_t x = 0; x < camera.width; ++x) {
        const auto value = static_cast<std::uint16_t>(first + y * camera.width + x);
        if (y * camera.stride() + 2 * x + 2 <= memory.size())
          std::memcpy(&memory[y * camera.stride() + 2 * x], &value, 2);
      }
    }
    const std::int64_t stamp_ns = how.stamp_ns != 0 ? how.stamp_ns : monotonic_ns();
    buffer.sequence = number;
    buffer.flags = how.flags | camera.stamps;
    buffer.bytesused = static_cast<std::uint32_t>(how.bytes != 0 ? how.bytes : camera.bytes());
    buffer.timestamp = {stamp_ns / 1'000'000'000, stamp_ns % 1'000'000'000 / 1000};
    camera.done.push_back(buffer);
    changed_.notify_all();
    return true;
  }

  int open(const char* path) noexcept override {
    const std::lock_guard lock(mutex_);
    const auto at = cameras_.find(path);
    if (at == cameras_.end() || !at->second.there) return fail(ENOENT);
    if (at->second.open_refused != 0) return fail(at->second.open_refused);
    ++at->second.opened;
    open_[++last_fd_] = path;
    return last_fd_;
  }
  void close(int fd) noexcept override {
    const std::lock_guard lock(mutex_);
    if (FakeCamera* camera = of(fd)) stop(*camera);
    open_.erase(fd);
  }
  void* map(int fd, std::size_t bytes, std::int64_t offset) noexcept override {
    const std::lock_guard lock(mutex_);
    FakeCamera* const camera = of(fd);
    if (camera == nullptr || static_cast<std::size_t>(offset) >= camera->memory.size()) return nullptr;
    auto& memory = camera->memory[static_cast<std::size_t>(offset)];
    return memory.size() == bytes ? memory.data() : nullptr;
  }
  void unmap(void* /*memory*/, std::size_t /*bytes*/) noexcept override {}
  std::vector<VideoNode> nodes() override {
    const std::lock_guard lock(mutex_);
    std::vector<VideoNode> found;
    for (const auto& [path, camera] : cameras_) {
      if (camera.there) found.push_back({path, camera.serial});
    }
    return found;
  }
  int poll(int fd, int timeout_ms) noexcept override {
    std::unique_lock lock(mutex_);
    const auto ready = [&] {
      const FakeCamera* const camera = of(fd);
      return camera == nullptr || !camera->there || camera->take_refused != 0 || camera->endless ||
             !camera->done.empty();
    };
    return changed_.wait_for(lock, std::chrono::milliseconds(timeout_ms), ready) ? 1 : 0;
  }

  int ioctl(int fd, unsigned long request, void* argument) noexcept override {
    const std::lock_guard lock(mutex_);
    FakeCamera* const camera = of(fd);
    if (camera == nullptr || !camera->there) return fail(ENODEV);
    switch (request) {
      case VIDIOC_QUERYCAP: {
        auto& answer = *static_cast<v4l2_capability*>(argument);
        answer.capabilities = answer.device_caps = camera->capabilities | V4L2_CAP_DEVICE_CAPS;
        std::memcpy(answer.card, camera->card.data(), std::min(camera->card.size(), sizeof answer.card));
        return 0;
      }
      case VIDIOC_ENUM_FMT: {
        auto& answer = *static_cast<v4l2_fmtdesc*>(argument);
        if (camera->no_end_of_lists) answer.index = 0;
        if (answer.index >= camera->formats.size()) return fail(EINVAL);
        answer.pixelformat = camera->formats[answer.index];
        return 0;
      }
      case VIDIOC_S_FMT: {
        if (camera->busy != 0) return fail(camera->busy);
        const std::uint32_t asked = static_cast<v4l2_format*>(argument)->fmt.pix.pixelformat;
        for (const std::uint32_t code : camera->formats) camera->code = code == asked ? code : camera->code;
        return fill_format(*camera, argument);
      }
      case VIDIOC_G_FMT:
        return fill_format(*camera, argument);
      case VIDIOC_G_PARM:
        static_cast<v4l2_streamparm*>(argument)->parm.capture.timeperframe = camera->period;
        return camera->period.denominator != 0 ? 0 : fail(ENOTTY);
      case VIDIOC_REQBUFS: {
        if (camera->busy != 0) return fail(camera->busy);
        std::uint32_t& count = static_cast<v4l2_requestbuffers*>(argument)->count;
        camera->memory.assign(camera->no_end_of_lists ? 100 : count, std::vector<std::byte>(camera->bytes()));
        if (camera->no_end_of_lists) count = UINT32_MAX;
        return 0;
      }
      case VIDIOC_QUERYBUF: {
        auto& buffer = *static_cast<v4l2_buffer*>(argument);
        buffer.length = static_cast<std::uint32_t>(camera->bytes());
        buffer.m.offset = buffer.index;
        return 0;
      }
      case VIDIOC_QBUF:
        camera->queued.push_back(static_cast<v4l2_buffer*>(argument)->index);
        return 0;
      case VIDIOC_DQBUF:
        if (camera->take_refused != 0) ++camera->refusals;
        if (camera->take_refused != 0) return fail(camera->take_refused);
        static_cast<v4l2_buffer*>(argument)->bytesused = 7;
        if (camera->endless) return 0;
        if (camera->done.empty()) return fail(EAGAIN);
        *static_cast<v4l2_buffer*>(argument) = camera->done.front();
        camera->done.pop_front();
        return 0;
      case VIDIOC_STREAMON:
        camera->streaming = true;
        return 0;
      case VIDIOC_STREAMOFF:
        stop(*camera);
        return 0;
      default:
        return fail(ENOTTY);
    }
  }

 private:
  static int fail(int error) noexcept {
    errno = error;
    return -1;
  }
  FakeCamera* of(int fd) noexcept {
    const auto at = open_.find(fd);
    return at == open_.end() ? nullptr : &cameras_[at->second];
  }
  static void stop(FakeCamera& camera) noexcept {
    camera.streaming = false;
    camera.queued.clear();
    camera.done.clear();
  }
  static int fill_format(const FakeCamera& camera, void* argument) noexcept {
    v4l2_pix_format& pixels = static_cast<v4l2_format*>(argument)->fmt.pix;
    pixels.pixelformat = camera.code;
    pixels.width = camera.width;
    pixels.height = camera.height;
    pixels.bytesperline = static_cast<std::uint32_t>(camera.stride());
    pixels.sizeimage = static_cast<std::uint32_t>(camera.bytes());
    return 0;
  }

  std::mutex mutex_;
  std::condition_variable changed_;
  std::map<std::string, FakeCamera> cameras_;
  std::map<int, std::string> open_;
  int last_fd_ = 100;
};

}  // namespace bolo::v4l2_source::test

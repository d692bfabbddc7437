#pragma once

#include "drivers/v4l2/video_port.hpp"
#include "tests/test.hpp"

namespace bolo::v4l2::test {

// State and input of a fake device, shared by the test and the port, which the sink owns.
struct FakeDevice {
  std::mutex mutex;
  std::condition_variable changed;
  bool there = true;
  bool stuck = false;
  int refused = 0;  // opens that fail for lack of memory
  int answer = 0;   // result of a write
  int opened = 0;
  int closed = 0;
  std::uint64_t writes = 0;
  std::vector<std::byte> last;

  template <typename Change>
  void set(Change change) {
    const std::lock_guard lock(mutex);
    change();
    changed.notify_all();
  }
  template <typename Condition>
  bool await(Condition condition, std::chrono::seconds time = std::chrono::seconds(60)) {
    std::unique_lock lock(mutex);
    return changed.wait_for(lock, time, condition);
  }
};

class FakePort final : public VideoPort {
 public:
  explicit FakePort(std::shared_ptr<FakeDevice> device, std::string path = "/dev/video10")
      : device_(std::move(device)), path_(std::move(path)) {}

  Status open(const VideoFormat& /*format*/) override {
    const std::lock_guard lock(device_->mutex);
    if (device_->refused > 0 && device_->refused-- > 0) throw std::bad_alloc();
    if (!device_->there) return bad_input(path_ + " is not there");
    ++device_->opened;
    device_->changed.notify_all();
    return {};
  }
  int write(std::span<const std::byte> image) noexcept override {
    std::unique_lock lock(device_->mutex);
    ++device_->writes;
    device_->changed.notify_all();
    device_->changed.wait(lock, [this] { return !device_->stuck; });
    if (!device_->there) return ENODEV;
    if (device_->answer == 0) device_->last.assign(image.begin(), image.end());
    device_->changed.notify_all();
    return device_->answer;
  }
  void close() noexcept override {
    device_->set([this] { ++device_->closed; });
  }
  const std::string& path() const noexcept override { return path_; }

 private:
  std::shared_ptr<FakeDevice> device_;
  std::string path_;
};

}  // namespace bolo::v4l2::test

// A USB camera without hardware: its files in /sys and /dev, and what the kernel answers, by umockdev.
#pragma once

#include <umockdev.h>

#include "tests/test.hpp"

namespace bolo::usb::testing {

inline constexpr std::uint16_t kProduct = 0x1007;
inline constexpr std::uint8_t kEndpoint = 0x81;
inline constexpr int kInterface = 0;
inline constexpr int kStreaming = 1;  // the alternate setting with the endpoint
inline constexpr int kPacketBytes = 512;

// Stands in for all USB of this process while it lives: there is nothing but the camera, and that only while plugged.
class MockCamera {
 public:
  explicit MockCamera(std::string serial = "SN-1", std::uint16_t vendor = 0x09cb);
  ~MockCamera();
  MockCamera(const MockCamera&) = delete;
  MockCamera& operator=(const MockCamera&) = delete;

  // Each time with the next address, as the kernel does.
  void plug();
  // As the kernel does: every request fails from then on.
  void unplug();
  int address() const { return address_; }

 private:
  struct Unref {
    void operator()(void* object) const { g_object_unref(object); }
  };
  struct UnrefData {
    void operator()(UMockdevIoctlData* data) const { umockdev_ioctl_data_unref(data); }
  };
  using Urb = std::unique_ptr<UMockdevIoctlData, UnrefData>;

  static gboolean on_ioctl(UMockdevIoctlBase*, UMockdevIoctlClient* client, MockCamera* self);
  gboolean handle(UMockdevIoctlClient* client);
  void submit(UMockdevIoctlClient* client, UMockdevIoctlData* argument);
  void answer_control(Urb urb);
  void reap(UMockdevIoctlClient* client, UMockdevIoctlData* argument);
  std::vector<std::uint8_t> descriptor(std::uint16_t value) const;
  std::string sysfs_text() const;
  std::string node() const;

  const std::string serial_;
  const std::uint16_t vendor_;
  int address_ = 0;

  std::mutex mutex_;  // guards what follows up to done_: the handler has a thread of its own
  bool plugged_ = false;
  std::deque<Urb> done_;  // control transfers with their answer, oldest first

  std::unique_ptr<UMockdevTestbed, Unref> testbed_;
  std::unique_ptr<UMockdevIoctlBase, Unref> handler_;  // last: making it starts its thread
};

}  // namespace bolo::usb::testing

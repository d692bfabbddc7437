// A USB camera without hardware: its files in /sys and /dev, and what the kernel answers, by umockdev.
#pragma once

#include <umockdev.h>

#include <cstddef>
#include <cstdint>
#include <deque>
#include <memory>
#include <mutex>
#include <string>
#include <vector>

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
  // As the kernel does: transfers come back with an error, and nothing else works from then on.
  void unplug();
  int address() const { return address_; }

  // What the endpoint sends next, ended by a short packet.
  void send(std::vector<std::byte> bytes);
  // The same without an end: what is sent next follows in the same transfer.
  void send_on(std::vector<std::byte> bytes);
  // The next transfer ends with this errno. EPIPE also halts the endpoint until it is cleared.
  void fail(int error);
  // Control requests of this number are stalled.
  void refuse(std::uint8_t request);

  int halts_cleared() const;
  // Requests to the device since it was plugged, as the eight bytes of set-up and what followed.
  std::vector<std::vector<std::uint8_t>> requests() const;
  bool interface_claimed() const;
  int alternate_setting() const;
  // Everything that was sent has been taken.
  bool idle() const;

 private:
  struct Answer {
    std::vector<std::byte> bytes;
    bool ends = true;
    int error = 0;
  };
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
  void discard(UMockdevIoctlClient* client, UMockdevIoctlData* argument);
  bool fill_next();
  std::vector<std::uint8_t> descriptor(std::uint16_t value) const;
  std::string sysfs_text() const;
  std::string node() const;

  const std::string serial_;
  const std::uint16_t vendor_;
  int address_ = 0;

  mutable std::mutex mutex_;  // guards what follows up to done_: the handler has a thread of its own
  bool plugged_ = false;
  bool halted_ = false;
  bool claimed_ = false;
  int alternate_setting_ = 0;
  int halts_cleared_ = 0;
  std::vector<std::uint8_t> refused_;
  std::vector<std::vector<std::uint8_t>> requests_;
  std::deque<Answer> answers_;
  std::deque<Urb> waiting_;  // bulk transfers under way, oldest first
  std::size_t filled_ = 0;   // bytes of the oldest that have come
  std::deque<Urb> done_;

  std::unique_ptr<UMockdevTestbed, Unref> testbed_;
  std::unique_ptr<UMockdevIoctlBase, Unref> handler_;  // last: making it starts its thread
};

}  // namespace bolo::usb::testing

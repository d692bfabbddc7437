// A USB camera without hardware, by umockdev: its files in /sys and /dev, and the kernel's answers.
#pragma once

#include <linux/usbdevice_fs.h>
#include <sys/ioctl.h>
#include <umockdev.h>

#include "tests/test.hpp"

namespace bolo::usb::testing {

inline constexpr std::uint16_t kProduct = 0x1007;
inline constexpr std::uint8_t kEndpoint = 0x81;
inline constexpr int kInterface = 0;
inline constexpr int kStreaming = 1;  // the alternate setting with the endpoint
inline constexpr int kPacketBytes = 512;

inline constexpr char kPath[] = "/sys/devices/usb1/1-2";
inline constexpr std::size_t kSetupBytes = 8;
inline constexpr unsigned kIdleUs = 500;  // a mocked node is always ready; keeps libusb from busy polling

inline void append(std::vector<std::uint8_t>& all, std::initializer_list<int> bytes) {
  for (const int byte : bytes) all.push_back(static_cast<std::uint8_t>(byte));
}

inline std::vector<std::uint8_t> device_descriptors(std::uint16_t vendor) {
  std::vector<std::uint8_t> all;
  append(all, {18, 1, 0x10, 0x02, 0, 0, 0, 64, vendor & 0xFF, vendor >> 8, kProduct & 0xFF, kProduct >> 8, 0x02, 0x01,
               1, 2, 3, 1});
  append(all, {9, 2, 39, 0, 1, 1, 0, 0xC0, 50});         // 39 bytes, one interface, self-powered, 100 mA
  append(all, {9, 4, kInterface, 0, 0, 0xFF, 1, 2, 4});  // no endpoint
  append(all, {9, 4, kInterface, kStreaming, 1, 0xFF, 1, 2, 4});
  append(all, {5, 0x24, 0xAB, 0xCD, 0xEF});  // class specific
  append(all, {7, 5, kEndpoint, 2, kPacketBytes & 0xFF, kPacketBytes >> 8, 0});
  return all;
}

inline std::vector<std::uint8_t> string_descriptor(const std::string& text) {
  std::vector<std::uint8_t> all{static_cast<std::uint8_t>(2 + 2 * text.size()), 3};
  for (const char c : text) append(all, {c, 0});
  return all;
}

inline usbdevfs_urb& urb_of(UMockdevIoctlData* data) { return *reinterpret_cast<usbdevfs_urb*>(data->data); }

// Replaces all USB devices of this process while it exists: only this camera, and only while plugged.
class MockCamera {
 public:
  explicit MockCamera(std::string serial = "SN-1", std::uint16_t vendor = 0x09cb)
      : serial_(std::move(serial)),
        vendor_(vendor),
        testbed_(umockdev_testbed_new()),
        handler_(umockdev_ioctl_base_new()) {
    g_signal_connect(handler_.get(), "handle-ioctl", G_CALLBACK(&MockCamera::on_ioctl), this);
  }
  ~MockCamera() {
    if (plugged_) unplug();
    testbed_.reset();
    handler_.reset();                    // ends its thread
    const std::lock_guard lock(mutex_);  // last held by that thread
    done_.clear();
  }
  MockCamera(const MockCamera&) = delete;
  MockCamera& operator=(const MockCamera&) = delete;

  // Uses the next address each time, like the kernel.
  void plug() {
    ++address_;
    {
      const std::lock_guard lock(mutex_);
      plugged_ = true;
    }
    GError* error = nullptr;
    umockdev_testbed_attach_ioctl(testbed_.get(), node().c_str(), handler_.get(), &error);
    if (error == nullptr) umockdev_testbed_add_from_string(testbed_.get(), sysfs_text().c_str(), &error);
    if (error != nullptr) throw std::runtime_error(error->message);
  }
  // Every later request fails, as in the kernel.
  void unplug() {
    {
      const std::lock_guard lock(mutex_);
      plugged_ = false;
    }
    umockdev_testbed_uevent(testbed_.get(), kPath, "remove");
    umockdev_testbed_remove_device(testbed_.get(), kPath);
  }
  int address() const { return address_; }

 private:
  struct Unref {
    void operator()(void* object) const { g_object_unref(object); }
  };
  struct UnrefData {
    void operator()(UMockdevIoctlData* data) const { umockdev_ioctl_data_unref(data); }
  };
  using Urb = std::unique_ptr<UMockdevIoctlData, UnrefData>;

  // Handler's thread, down to reap().
  static gboolean on_ioctl(UMockdevIoctlBase*, UMockdevIoctlClient* client, MockCamera* self) {
    const std::lock_guard lock(self->mutex_);
    const int error = self->answer(umockdev_ioctl_client_get_request(client), umockdev_ioctl_client_get_arg(client));
    umockdev_ioctl_client_complete(client, error == 0 ? 0 : -1, error);
    return TRUE;
  }
  // Return 0 or an errno.
  int answer(gulong request, UMockdevIoctlData* argument) {
    if (request == USBDEVFS_REAPURB || request == USBDEVFS_REAPURBNDELAY) return reap(argument);
    if (!plugged_) return ENODEV;
    if (request == USBDEVFS_SUBMITURB) return submit(argument);
    if (request != USBDEVFS_GET_CAPABILITIES) return ENOTTY;
    const Urb room(umockdev_ioctl_data_resolve(argument, 0, sizeof(guint32), nullptr));
    const guint32 can = USBDEVFS_CAP_BULK_SCATTER_GATHER | USBDEVFS_CAP_BULK_CONTINUATION |
                        USBDEVFS_CAP_NO_PACKET_SIZE_LIM | USBDEVFS_CAP_REAP_AFTER_DISCONNECT;
    std::memcpy(room->data, &can, sizeof can);
    return 0;
  }
  int submit(UMockdevIoctlData* argument) {
    Urb urb(umockdev_ioctl_data_resolve(argument, 0, sizeof(usbdevfs_urb), nullptr));
    usbdevfs_urb& asked = urb_of(urb.get());
    const Urb buffer(umockdev_ioctl_data_resolve(urb.get(), offsetof(usbdevfs_urb, buffer),
                                                 static_cast<gsize>(asked.buffer_length), nullptr));
    if (asked.type != USBDEVFS_URB_TYPE_CONTROL) return EINVAL;
    auto* bytes = static_cast<std::uint8_t*>(asked.buffer);
    const std::vector<std::uint8_t> setup(bytes, bytes + asked.buffer_length);
    constexpr std::uint8_t kGetDescriptor = 6;
    const bool asks_descriptor = setup[0] == 0x80 && setup[1] == kGetDescriptor;
    const auto found = asks_descriptor ? descriptor(static_cast<std::uint16_t>(setup[2] | setup[3] << 8))
                                       : std::vector<std::uint8_t>();
    asked.actual_length = static_cast<int>(std::min(found.size(), setup.size() - kSetupBytes));
    std::copy_n(found.begin(), asked.actual_length, bytes + kSetupBytes);
    asked.status = found.empty() ? -EPIPE : 0;
    done_.push_back(std::move(urb));
    return 0;
  }
  int reap(UMockdevIoctlData* argument) {
    if (done_.empty()) {
      g_usleep(kIdleUs);
      return plugged_ ? EAGAIN : ENODEV;
    }
    const Urb urb = std::move(done_.front());
    done_.pop_front();
    const Urb pointer(umockdev_ioctl_data_resolve(argument, 0, sizeof(void*), nullptr));
    umockdev_ioctl_data_set_ptr(pointer.get(), 0, urb.get());
    return 0;
  }
  std::vector<std::uint8_t> descriptor(std::uint16_t value) const {
    constexpr unsigned kString = 3;
    constexpr unsigned kBos = 15;
    if (value >> 8 == kBos) return {5, 15, 12, 0, 1, 7, 16, 2, 6, 0, 0, 0};  // USB 2.0 extension: link power management
    if (value >> 8 != kString) return {};
    if ((value & 0xFF) == 0) return {4, 3, 0x09, 0x04};  // English
    if ((value & 0xFF) == 4) return string_descriptor("Thermal stream");
    return {};
  }
  std::string node() const {
    std::array<char, 32> text{};
    std::snprintf(text.data(), text.size(), "/dev/bus/usb/001/%03d", address_);
    return text.data();
  }
  std::string sysfs_text() const {
    std::string hex;
    for (const std::uint8_t byte : device_descriptors(vendor_)) {
      std::array<char, 3> two{};
      std::snprintf(two.data(), two.size(), "%02x", static_cast<unsigned>(byte));
      hex += two.data();
    }
    const std::string number = node().substr(node().size() - 3);
    return "P: /devices/usb1/1-2\nN: bus/usb/001/" + number + "\nE: SUBSYSTEM=usb\nE: DRIVER=usb\nE: BUSNUM=001\n" +
           "E: DEVNUM=" + number + "\nE: DEVNAME=" + node() + "\nE: DEVTYPE=usb_device\nA: bConfigurationValue=1\\n\n" +
           "A: busnum=1\\n\nA: devnum=" + std::to_string(address_) +
           "\\n\nA: speed=480\\n\nA: manufacturer=FLIR Systems\\n\n" +
           "A: product=Mock microbolometer\\n\nA: serial=" + serial_ + "\\n\nH: descriptors=" + hex + "\n";
  }

  const std::string serial_;
  const std::uint16_t vendor_;
  int address_ = 0;

  std::mutex mutex_;  // guards the members down to done_ from the handler's thread
  bool plugged_ = false;
  std::deque<Urb> done_;  // control transfers with their answer, oldest first

  std::unique_ptr<UMockdevTestbed, Unref> testbed_;
  std::unique_ptr<UMockdevIoctlBase, Unref> handler_;  // last: its construction starts the thread
};

}  // namespace bolo::usb::testing

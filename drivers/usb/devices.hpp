// Connected USB devices, and ownership of libusb's objects.
#pragma once

#include <atomic>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <thread>
#include <vector>

#include <libusb.h>

#include "src/core/result.hpp"

namespace bolo::usb {

struct ExitContext {
  void operator()(libusb_context* context) const noexcept { libusb_exit(context); }
};
struct CloseHandle {
  void operator()(libusb_device_handle* handle) const noexcept { libusb_close(handle); }
};
using Context = std::unique_ptr<libusb_context, ExitContext>;
using Handle = std::unique_ptr<libusb_device_handle, CloseHandle>;

// libusb's text for an error code. Thread: any.
inline std::string reason(int code) { return libusb_strerror(static_cast<libusb_error>(code)); }

// kFailed: this system has no USB, or denies access to it. Thread: setup.
Result<Context> make_context();

// Snapshot of the connected devices; holds a reference to each. Thread: any.
class DeviceList {
 public:
  explicit DeviceList(libusb_context* context) : size_(libusb_get_device_list(context, &devices_)) {}
  ~DeviceList() {
    if (devices_ != nullptr) libusb_free_device_list(devices_, 1);
  }
  DeviceList(const DeviceList&) = delete;
  DeviceList& operator=(const DeviceList&) = delete;

  libusb_device* const* begin() const { return devices_; }
  libusb_device* const* end() const { return devices_ + (size_ > 0 ? size_ : 0); }
  int error() const { return size_ < 0 ? static_cast<int>(size_) : 0; }

 private:
  libusb_device** devices_ = nullptr;
  std::ptrdiff_t size_;
};

struct UsbDevice {
  int bus = 0;
  int address = 0;
  std::string port_path;  // kernel name: "1-2.3" is bus 1, port 2 of the root hub, port 3 of the hub there
  std::uint16_t vendor = 0;
  std::uint16_t product = 0;
  std::uint16_t release = 0;  // bcdDevice: 0x0102 is 1.02
  std::string speed;          // "480 Mbit/s"
  // Empty if the device has none, or if this user can read it neither from the kernel nor from the device.
  std::string manufacturer;
  std::string product_name;
  std::string serial;
  std::string node;      // "/dev/bus/usb/001/004"
  bool allowed = false;  // this user may read and write the node, as needed to open the device

  bool operator==(const UsbDevice&) const = default;
};

// Selects devices: all given parts must match.
struct DeviceFilter {
  std::optional<std::uint16_t> vendor;
  std::optional<std::uint16_t> product;
  std::optional<int> bus;
  std::optional<int> address;
  std::string serial;  // empty: any

  // Thread: any.
  bool matches(const UsbDevice& device) const;
  // "USB device 09cb:1007 with serial number 123", for messages. Thread: any.
  std::string text() const;
};

// "09cb:1007". Thread: any.
std::string id_text(std::uint16_t vendor, std::uint16_t product);

// Parses "09cb:1007". kBadInput: not two numbers of four hexadecimal digits. Thread: any.
Result<DeviceFilter> parse_ids(std::string_view text);

// Reads from the kernel, which needs no permission; strings unknown to the kernel are read from the device if this user
// may open it. Performs transfers: do not call from a libusb callback. Thread: setup.
UsbDevice describe(libusb_device* device);

// Sorted by bus and address. kFailed: USB cannot be read. Thread: setup.
Result<std::vector<UsbDevice>> list_devices(libusb_context* context, const DeviceFilter& filter);
Result<std::vector<UsbDevice>> list_devices(const DeviceFilter& filter);

// --- All descriptors of a USB device as text, to support cameras with an unknown protocol.

// For each matching device: device, configurations, interfaces with their alternate settings, endpoints, class-specific
// descriptors in hexadecimal, strings and BOS; a remark where permission is missing. kBadInput: no device matches.
// Performs transfers. Thread: setup.
Result<std::string> descriptor_report(const DeviceFilter& filter);

// --- Hotplug: devices that are connected or disconnected.

// Watches on its own thread from start() until destruction.
class Hotplug {
 public:
  enum class Change { kArrived, kLeft };
  // By libusb's events, or by listing the devices every 0.3 s, which is also the fallback on systems without events.
  enum class Means { kEvents, kPolling };
  // Called on the watching thread; devices already present are reported as arrivals first.
  using Callback = std::function<void(Change change, const UsbDevice& device)>;

  // kFailed: USB cannot be read. Thread: setup.
  static Result<std::unique_ptr<Hotplug>> start(DeviceFilter filter, Callback callback, Means means = Means::kEvents);
  // The callback is not called after it returns. Thread: setup.
  ~Hotplug();

 private:
  Hotplug(Context context, DeviceFilter filter, Callback callback, Means means);
  static int LIBUSB_CALL on_event(libusb_context* context, libusb_device* device, libusb_hotplug_event event,
                                  void* self);
  void run();
  void compare();

  Context context_;
  const DeviceFilter filter_;
  const Callback callback_;
  std::vector<UsbDevice> known_;  // watching thread only, like changed_
  bool changed_ = true;
  libusb_hotplug_callback_handle registration_ = 0;
  bool has_events_ = false;
  std::atomic<bool> stop_{false};  // relaxed: publishes no other data
  std::thread thread_;
};

}  // namespace bolo::usb

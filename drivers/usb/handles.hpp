// Ownership of libusb's objects.
#pragma once

#include <libusb.h>

#include <cstddef>
#include <memory>
#include <string>

#include "src/core/result.hpp"

namespace bolo::usb {

struct ExitContext {
  void operator()(libusb_context* context) const noexcept { libusb_exit(context); }
};
struct CloseHandle {
  void operator()(libusb_device_handle* handle) const noexcept { libusb_close(handle); }
};
struct FreeConfig {
  void operator()(libusb_config_descriptor* config) const noexcept { libusb_free_config_descriptor(config); }
};

using Context = std::unique_ptr<libusb_context, ExitContext>;
using Handle = std::unique_ptr<libusb_device_handle, CloseHandle>;
using Config = std::unique_ptr<libusb_config_descriptor, FreeConfig>;

// libusb's words for one of its error codes. Thread: any.
inline std::string reason(int code) { return libusb_strerror(static_cast<libusb_error>(code)); }

// kFailed: this system has no USB, or does not let it be looked at. Thread: setup.
inline Result<Context> make_context() {
  libusb_context* context = nullptr;
  if (const int code = libusb_init(&context); code != 0) return failed("USB: libusb does not start: " + reason(code));
  return Context(context);
}

// The devices of a moment, each held until this goes. Thread: any.
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
  // 0, or libusb's error code.
  int error() const { return size_ < 0 ? static_cast<int>(size_) : 0; }

 private:
  libusb_device** devices_ = nullptr;
  std::ptrdiff_t size_;
};

// Descriptor of a configuration by its index; null when the device does not give it. Thread: any.
inline Config config_of(libusb_device* device, std::uint8_t index) {
  libusb_config_descriptor* config = nullptr;
  if (libusb_get_config_descriptor(device, index, &config) != 0) return nullptr;
  return Config(config);
}

}  // namespace bolo::usb

// Which USB devices are there.
#pragma once

#include <libusb.h>

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "src/core/result.hpp"

namespace bolo::usb {

inline constexpr std::uint16_t kFlirVendor = 0x09cb;

struct UsbDevice {
  int bus = 0;
  int address = 0;
  std::string port_path;  // the kernel's name: "1-2.3" is bus 1, port 2 of the root hub, port 3 of the hub there
  std::uint16_t vendor = 0;
  std::uint16_t product = 0;
  std::uint16_t release = 0;  // bcdDevice: 0x0102 is 1.02
  std::string speed;          // "480 Mbit/s"
  // Empty where the device has none, or where neither the kernel nor the device tells it to this user.
  std::string manufacturer;
  std::string product_name;
  std::string serial;
  std::string node;      // "/dev/bus/usb/001/004"
  bool allowed = false;  // this user may read and write the node, which opening the device takes

  bool operator==(const UsbDevice&) const = default;
};

// What is meant: every part that is given must agree.
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

// From "09cb:1007". kBadInput: not two numbers of four hexadecimal digits. Thread: any.
Result<DeviceFilter> parse_ids(std::string_view text);

// What the kernel knows, which needs no permission; strings that it does not know are asked of the device where this
// user may open it. Talks to the device: not within a callback of libusb. Thread: setup.
UsbDevice describe(libusb_device* device);

// In the order of bus and address. kFailed: USB cannot be looked at. Thread: setup.
Result<std::vector<UsbDevice>> list_devices(libusb_context* context, const DeviceFilter& filter);
Result<std::vector<UsbDevice>> list_devices(const DeviceFilter& filter);

}  // namespace bolo::usb

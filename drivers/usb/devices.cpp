#include "drivers/usb/devices.hpp"

#include <unistd.h>

#include <algorithm>
#include <array>
#include <charconv>
#include <fstream>
#include <tuple>

#include <fmt/format.h>

namespace bolo::usb {
namespace {

// USB 3 allows hubs seven levels deep.
constexpr int kMostPorts = 7;

std::string port_path(libusb_device* device) {
  const int bus = libusb_get_bus_number(device);
  std::array<std::uint8_t, kMostPorts> ports{};
  const int count = libusb_get_port_numbers(device, ports.data(), kMostPorts);
  if (count <= 0) return "usb" + std::to_string(bus);
  return fmt::format("{}-{}", bus, fmt::join(ports.begin(), ports.begin() + count, "."));
}

std::string speed_text(int speed) {
  switch (speed) {
    case LIBUSB_SPEED_LOW:
      return "1.5 Mbit/s";
    case LIBUSB_SPEED_FULL:
      return "12 Mbit/s";
    case LIBUSB_SPEED_HIGH:
      return "480 Mbit/s";
    case LIBUSB_SPEED_SUPER:
      return "5 Gbit/s";
    case LIBUSB_SPEED_SUPER_PLUS:
      return "10 Gbit/s";
    default:
      return "unknown speed";
  }
}

// As the kernel read it when the device was connected.
std::string kernel_string(const std::string& port_path, const char* name) {
  std::ifstream file("/sys/bus/usb/devices/" + port_path + "/" + name);
  std::string text;
  std::getline(file, text);
  return text;
}

std::string device_string(libusb_device_handle* handle, std::uint8_t index) {
  std::array<unsigned char, 256> text{};
  const int size = libusb_get_string_descriptor_ascii(handle, index, text.data(), static_cast<int>(text.size()));
  return size > 0 ? std::string(text.data(), text.data() + size) : std::string();
}

// Fills in those strings that the kernel does not have.
void read_missing_strings(libusb_device* device, const libusb_device_descriptor& descriptor, UsbDevice& found) {
  struct Wanted {
    std::string* text;
    std::uint8_t index;
  };
  const std::array<Wanted, 3> strings{{{&found.manufacturer, descriptor.iManufacturer},
                                       {&found.product_name, descriptor.iProduct},
                                       {&found.serial, descriptor.iSerialNumber}}};
  const auto missing = [](const Wanted& w) { return w.index != 0 && w.text->empty(); };
  if (!found.allowed || std::none_of(strings.begin(), strings.end(), missing)) return;
  libusb_device_handle* opened = nullptr;
  if (libusb_open(device, &opened) != 0) return;
  const Handle handle(opened);
  for (const Wanted& wanted : strings) {
    if (missing(wanted)) *wanted.text = device_string(opened, wanted.index);
  }
}

}  // namespace

Result<Context> make_context() {
  libusb_context* context = nullptr;
  if (const int code = libusb_init(&context); code != 0) return failed("USB: libusb does not start: " + reason(code));
  return Context(context);
}

std::string id_text(std::uint16_t vendor, std::uint16_t product) {
  return fmt::format("{:04x}:{:04x}", vendor, product);
}

Result<DeviceFilter> parse_ids(std::string_view text) {
  constexpr std::size_t kDigits = 4;
  const auto number = [](std::string_view digits) -> std::optional<std::uint16_t> {
    std::uint16_t value = 0;
    const char* const end = digits.data() + digits.size();
    const auto [read, error] = std::from_chars(digits.data(), end, value, 16);
    return error == std::errc() && read == end ? std::optional(value) : std::nullopt;
  };
  DeviceFilter filter;
  if (text.size() == 2 * kDigits + 1 && text[kDigits] == ':') {
    filter.vendor = number(text.substr(0, kDigits));
    filter.product = number(text.substr(kDigits + 1));
  }
  if (filter.vendor && filter.product) return filter;
  return bad_input("'" + std::string(text) + "' is not VENDOR:PRODUCT, four hexadecimal digits each, as 09cb:1007");
}

bool DeviceFilter::matches(const UsbDevice& device) const {
  return vendor.value_or(device.vendor) == device.vendor && product.value_or(device.product) == device.product &&
         bus.value_or(device.bus) == device.bus && address.value_or(device.address) == device.address &&
         (serial.empty() || serial == device.serial);
}

std::string DeviceFilter::text() const {
  std::string text = "USB device";
  if (vendor && product) {
    text += " " + id_text(*vendor, *product);
  } else if (vendor) {
    text += fmt::format(" of vendor {:04x}", *vendor);
  }
  if (bus && address) text += fmt::format(" at {}:{}", *bus, *address);
  if (!serial.empty()) text += " with serial number " + serial;
  return text;
}

UsbDevice describe(libusb_device* device) {
  libusb_device_descriptor descriptor{};
  libusb_get_device_descriptor(device, &descriptor);  // never fails since libusb 1.0.16
  UsbDevice found;
  found.bus = libusb_get_bus_number(device);
  found.address = libusb_get_device_address(device);
  found.port_path = port_path(device);
  found.vendor = descriptor.idVendor;
  found.product = descriptor.idProduct;
  found.release = descriptor.bcdDevice;
  found.speed = speed_text(libusb_get_device_speed(device));
  found.manufacturer = kernel_string(found.port_path, "manufacturer");
  found.product_name = kernel_string(found.port_path, "product");
  found.serial = kernel_string(found.port_path, "serial");
  found.node = fmt::format("/dev/bus/usb/{:03}/{:03}", found.bus, found.address);
  found.allowed = access(found.node.c_str(), R_OK | W_OK) == 0;
  read_missing_strings(device, descriptor, found);
  return found;
}

Result<std::vector<UsbDevice>> list_devices(libusb_context* context, const DeviceFilter& filter) {
  const DeviceList devices(context);
  if (devices.error() != 0) return failed("USB: devices cannot be listed: " + reason(devices.error()));
  std::vector<UsbDevice> found;
  for (libusb_device* device : devices) {
    libusb_device_descriptor ids{};
    libusb_get_device_descriptor(device, &ids);
    // describe() may open the device: leave those of other vendors alone.
    if (filter.vendor.value_or(ids.idVendor) != ids.idVendor) continue;
    if (UsbDevice one = describe(device); filter.matches(one)) found.push_back(std::move(one));
  }
  std::sort(found.begin(), found.end(), [](const UsbDevice& a, const UsbDevice& b) {
    return std::tie(a.bus, a.address) < std::tie(b.bus, b.address);
  });
  return found;
}

Result<std::vector<UsbDevice>> list_devices(const DeviceFilter& filter) {
  const auto context = make_context();
  if (!context) return tl::unexpected<Error>(context.error());
  return list_devices(context->get(), filter);
}

}  // namespace bolo::usb

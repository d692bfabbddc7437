// Everything a USB device says of itself, as text: what support needs of a camera whose protocol nobody here has seen.
#pragma once

#include <libusb.h>

#include <string>

#include "drivers/usb/devices.hpp"
#include "src/core/result.hpp"

namespace bolo::usb {

// Device, configurations, interfaces with their alternate settings, endpoints, class-specific descriptors in
// hexadecimal, strings and BOS. What takes permission and was not given is said so. Talks to the device. Thread: setup.
std::string descriptor_report(libusb_device* device);

// The reports of all that match, one after the other. kBadInput: none does. Thread: setup.
Result<std::string> descriptor_report(const DeviceFilter& filter);

}  // namespace bolo::usb

// Every descriptor of a USB device as text, for support of cameras whose protocol is unknown.
#pragma once

#include <string>

#include "drivers/usb/devices.hpp"
#include "src/core/result.hpp"

namespace bolo::usb {

// Of each device that matches: device, configurations, interfaces with their alternate settings, endpoints,
// class-specific descriptors in hexadecimal, strings and BOS; where permission is missing, a line that says so.
// kBadInput: no device matches. Performs transfers. Thread: setup.
Result<std::string> descriptor_report(const DeviceFilter& filter);

}  // namespace bolo::usb

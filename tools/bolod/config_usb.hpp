// The keys of a camera that sends its frames over a USB bulk endpoint. Experimental, as its driver.
#pragma once

#include <string>

#include "drivers/genicam/genicam_source.hpp"
#include "drivers/usb/usb_source.hpp"
#include "src/core/result.hpp"
#include "src/model/strict_toml.hpp"

namespace bolo::daemon {

// As they are written in the file.
struct UsbKeys {
  std::string device;
  std::string start;
  std::string stop;
  std::string magic;
  int endpoint = 0x81;
  int header_bytes = 0;
  int trailer_bytes = 0;
  int counter_offset = 0;
  int counter_bytes = 0;
  bool counter_big_endian = false;
  usb::UsbOptions options;
};

// Declares [usb], bound to `usb`, which outlives the table. Thread: any.
void usb_keys(model::KeyTable& keys, UsbKeys& usb);

// What they mean, with what [source] says of every camera: size, rate, byte order, priority, watch. kBadInput with the
// place of the key. Thread: any.
Result<usb::UsbOptions> usb_options(const model::KeyTable& keys, const UsbKeys& usb,
                                    const genicam::CameraOptions& camera);

}  // namespace bolo::daemon

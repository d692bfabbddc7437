// A camera that sends its frames over a USB bulk endpoint, as a profile describes. Experimental: written against an
// emulated device; no camera whose protocol is known was at hand.
#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "drivers/usb/devices.hpp"
#include "drivers/usb/frame_layout.hpp"
#include "src/pipeline/source.hpp"

namespace bolo::usb {

// A request on the control endpoint, with the names of USB 2.0, table 9-2.
struct ControlRequest {
  std::uint8_t request_type = 0x40;  // bit 7: to the host. 0x40: to the device, vendor specific
  std::uint8_t request = 0;
  std::uint16_t value = 0;
  std::uint16_t index = 0;
  std::vector<std::uint8_t> data{};  // to the host: as many bytes as are asked for; what comes is not looked at
};

struct UsbOptions {
  std::uint16_t vendor = kFlirVendor;
  std::uint16_t product = 0;
  std::string serial;  // empty: the only one of these ids
  int interface = 0;
  int alternate_setting = 0;
  std::uint8_t endpoint = 0x81;  // bulk, to the host
  // Transfers that wait for data, a frame's worth each: how long the host may be late without the camera having to
  // wait.
  int transfers = 8;
  std::vector<ControlRequest> start{};  // sent in this order once transfers wait
  std::vector<ControlRequest> stop{};
  FrameLayout layout;
  LinearScale scale;
  double frame_period_s = 0.005;
  int realtime_priority = 0;      // of the receiving thread, 1..99; 0: the default scheduler
  int stall_ms = 250;             // without a frame for this long, and for 20 frame periods: stalled
  int reconnect_after_ms = 2000;  // stalled for this long: the camera is lost and opened again; 0: never
};

using pipeline::SourceState;

// One thread owns the connection from start() to stop(): it handles libusb's events, copies frames, clears halts, and
// opens a lost camera again. Nothing of ours allocates while frames flow; libusb does for each transfer.
//
// receive_ns is when a frame's last byte came, camera_ns the counter times the frame period (receive_ns without one).
// A loss is kIncomplete when the frame was cut off, kBadFrame when it was too long or without its magic, kMissing when
// the counter jumped, kDriver when the transfer failed, kOutOfOrder when the counter stood still.
class UsbBulkSource final : public pipeline::FrameSource {
 public:
  explicit UsbBulkSource(UsbOptions options);
  ~UsbBulkSource() override;
  UsbBulkSource(const UsbBulkSource&) = delete;
  UsbBulkSource& operator=(const UsbBulkSource&) = delete;

  // kBadInput: options that cannot be, no such device, several without a serial number, one that may not be opened or
  // that another program has, one without this interface or endpoint. Thread: setup.
  Result<pipeline::SourceInfo> open() override;

  // kFailed: the device refuses a start request. After stop() it connects again. A device that is lost is opened again
  // in the background until stop(), and its first frame then starts a new window. Thread: setup.
  Status start(pipeline::FrameInlet& inlet) override;

  // Sends the stop requests, and waits for them a second each at most. Thread: setup.
  void stop() noexcept override;

  // Of its fields those of state, loss and reopening. Thread: any.
  const pipeline::SourceStatus* status() const noexcept override;
  // Times that a halt of the endpoint, or another failure of transfers, was cleared. Thread: any.
  std::uint64_t recoveries() const noexcept;
  std::vector<pipeline::Notice> take_notices() override;
  // Fails: no way is known. Thread: any.
  Status correct() override;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace bolo::usb

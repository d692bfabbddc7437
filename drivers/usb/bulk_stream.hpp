// One connection to the camera: its interface claimed, transfers under way, until it is let go.
#pragma once

#include <libusb.h>

#include <memory>
#include <string>
#include <vector>

#include "drivers/usb/devices.hpp"
#include "drivers/usb/handles.hpp"
#include "drivers/usb/intake.hpp"
#include "drivers/usb/usb_source.hpp"
#include "src/core/result.hpp"

namespace bolo::usb {

// Everything happens on the thread that handles the context's events, transfers' completion too: one thread at a time
// may use this. Thread: setup until the source's thread runs, acquire from then on.
class BulkStream {
 public:
  enum class Trouble {
    kNone,
    kHalted,  // the endpoint is halted, or a transfer failed: recover()
    kGone,    // the device is not there any more
  };

  // Errors as UsbBulkSource::open(). The context outlives this.
  static Result<std::unique_ptr<BulkStream>> open(libusb_context* context, const UsbOptions& options);
  // Stops the camera, if it is there, and waits for the transfers to come back.
  ~BulkStream();
  BulkStream(const BulkStream&) = delete;
  BulkStream& operator=(const BulkStream&) = delete;

  const UsbDevice& device() const { return device_; }
  bool is(libusb_device* device) const { return libusb_get_device(handle_.get()) == device; }

  // Submits the transfers, then sends the start requests. The intake outlives this.
  Status begin(Intake& intake);
  Trouble trouble() const { return trouble_; }
  void set_gone() { trouble_ = Trouble::kGone; }
  // Takes all transfers back, clears the halt, submits them again. kFailed: the device does not let itself be helped.
  Status recover();

 private:
  struct FreeTransfer {
    void operator()(libusb_transfer* transfer) const noexcept { libusb_free_transfer(transfer); }
  };
  struct Slot {
    BulkStream* owner = nullptr;
    bool under_way = false;
    std::vector<unsigned char> buffer;
    std::unique_ptr<libusb_transfer, FreeTransfer> transfer;
  };

  BulkStream(libusb_context* context, const UsbOptions& options, UsbDevice device, Handle handle);

  Status claim();
  Status prepare();
  Status submit_all();
  void submit(Slot& slot) noexcept;
  Status send(const ControlRequest& request);
  void take_back() noexcept;
  static void LIBUSB_CALL on_transfer(libusb_transfer* transfer);
  void finish(Slot& slot) noexcept;

  libusb_context* context_;
  const UsbOptions options_;
  const UsbDevice device_;
  Handle handle_;
  Intake* intake_ = nullptr;
  bool claimed_ = false;
  bool begun_ = false;
  bool taking_back_ = false;  // transfers that come back are not submitted again
  Trouble trouble_ = Trouble::kNone;
  int under_way_ = 0;
  std::vector<Slot> slots_;  // never grows after prepare(): transfers point into it
};

}  // namespace bolo::usb

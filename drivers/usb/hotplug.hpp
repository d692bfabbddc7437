// Devices that come and go.
#pragma once

#include <libusb.h>

#include <atomic>
#include <functional>
#include <memory>
#include <thread>
#include <vector>

#include "drivers/usb/devices.hpp"
#include "drivers/usb/handles.hpp"
#include "src/core/result.hpp"

namespace bolo::usb {

// libusb's word that a device came or went, for as long as this lives; nothing where the system does not tell. The
// callback comes from whoever handles the context's events and must not talk to devices. Thread: setup.
class HotplugSignal {
 public:
  using Callback = std::function<void(libusb_device* device, bool arrived)>;

  HotplugSignal(libusb_context* context, Callback callback);
  ~HotplugSignal();
  HotplugSignal(const HotplugSignal&) = delete;
  HotplugSignal& operator=(const HotplugSignal&) = delete;

  bool told() const noexcept { return told_; }

 private:
  static int LIBUSB_CALL on_change(libusb_context* context, libusb_device* device, libusb_hotplug_event event,
                                   void* self);

  libusb_context* context_;
  Callback callback_;
  libusb_hotplug_callback_handle handle_ = 0;
  bool told_ = false;
};

// Watches on a thread of its own from start() until it is destroyed.
class Hotplug {
 public:
  enum class Change { kArrived, kLeft };
  // By libusb's events, or by listing the devices again and again, which is also what is done without events.
  enum class Means { kEvents, kPolling };
  // Called on the watching thread; devices that are there already arrive first.
  using Callback = std::function<void(Change change, const UsbDevice& device)>;

  // kFailed: USB cannot be looked at. Thread: setup.
  static Result<std::unique_ptr<Hotplug>> start(DeviceFilter filter, Callback callback, Means means = Means::kEvents);
  // The callback is not called any more when it returns. Thread: setup.
  ~Hotplug();
  Hotplug(const Hotplug&) = delete;
  Hotplug& operator=(const Hotplug&) = delete;

 private:
  Hotplug(Context context, DeviceFilter filter, Callback callback, Means means);
  void watch();
  void compare();

  Context context_;
  const DeviceFilter filter_;
  const Callback callback_;
  std::vector<UsbDevice> known_;  // watching thread only, as is changed_
  bool changed_ = true;
  std::atomic<bool> stop_{false};  // a flag and nothing else: relaxed
  std::unique_ptr<HotplugSignal> signal_;
  std::thread thread_;
};

}  // namespace bolo::usb

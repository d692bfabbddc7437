// Devices that come and go.
#pragma once

#include <libusb.h>

#include <atomic>
#include <functional>
#include <memory>
#include <thread>
#include <vector>

#include "drivers/usb/devices.hpp"
#include "src/core/result.hpp"

namespace bolo::usb {

// Watches on a thread of its own from start() until it is destroyed.
class Hotplug {
 public:
  enum class Change { kArrived, kLeft };
  // By libusb's events, or by listing the devices every 0.3 s, which is also the way of a system without events.
  enum class Means { kEvents, kPolling };
  // Called on the watching thread; devices that are there already arrive first.
  using Callback = std::function<void(Change change, const UsbDevice& device)>;

  // kFailed: USB cannot be read. Thread: setup.
  static Result<std::unique_ptr<Hotplug>> start(DeviceFilter filter, Callback callback, Means means = Means::kEvents);
  // The callback is not called any more when it returns. Thread: setup.
  ~Hotplug();
  Hotplug(const Hotplug&) = delete;
  Hotplug& operator=(const Hotplug&) = delete;

 private:
  Hotplug(Context context, DeviceFilter filter, Callback callback, Means means);
  static int LIBUSB_CALL on_event(libusb_context* context, libusb_device* device, libusb_hotplug_event event,
                                  void* self);
  void run();
  void compare();

  Context context_;
  const DeviceFilter filter_;
  const Callback callback_;
  std::vector<UsbDevice> known_;  // watching thread only, as is changed_
  bool changed_ = true;
  libusb_hotplug_callback_handle registration_ = 0;
  bool has_events_ = false;
  std::atomic<bool> stop_{false};  // a flag and nothing else: relaxed
  std::thread thread_;
};

}  // namespace bolo::usb

#include "drivers/usb/hotplug.hpp"

#include <sys/time.h>

#include <algorithm>
#include <chrono>
#include <utility>

#include "src/rt/thread.hpp"

namespace bolo::usb {
namespace {

constexpr timeval kWatchTick{0, 50'000};
constexpr std::chrono::milliseconds kPollPeriod(300);

// The same device in the same place: a replugged one has another address.
bool same(const UsbDevice& a, const UsbDevice& b) {
  return a.bus == b.bus && a.address == b.address && a.vendor == b.vendor && a.product == b.product;
}

bool has(const std::vector<UsbDevice>& devices, const UsbDevice& device) {
  return std::any_of(devices.begin(), devices.end(), [&](const UsbDevice& d) { return same(d, device); });
}

}  // namespace

Result<std::unique_ptr<Hotplug>> Hotplug::start(DeviceFilter filter, Callback callback, Means means) {
  ASSIGN_OR_RETURN(auto context, make_context());
  RETURN_IF_ERROR(list_devices(context.get(), filter));
  return std::unique_ptr<Hotplug>(new Hotplug(std::move(context), std::move(filter), std::move(callback), means));
}

Hotplug::Hotplug(Context context, DeviceFilter filter, Callback callback, Means means)
    : context_(std::move(context)), filter_(std::move(filter)), callback_(std::move(callback)) {
  if (means == Means::kEvents && libusb_has_capability(LIBUSB_CAP_HAS_HOTPLUG) != 0) {
    has_events_ = libusb_hotplug_register_callback(
                      context_.get(), LIBUSB_HOTPLUG_EVENT_DEVICE_ARRIVED | LIBUSB_HOTPLUG_EVENT_DEVICE_LEFT, 0,
                      LIBUSB_HOTPLUG_MATCH_ANY, LIBUSB_HOTPLUG_MATCH_ANY, LIBUSB_HOTPLUG_MATCH_ANY, &on_event, this,
                      &registration_) == 0;
  }
  thread_ = std::thread([this] { run(); });
}

Hotplug::~Hotplug() {
  stop_.store(true, std::memory_order_relaxed);
  thread_.join();
  if (has_events_) libusb_hotplug_deregister_callback(context_.get(), registration_);
}

int Hotplug::on_event(libusb_context*, libusb_device*, libusb_hotplug_event, void* self) {
  static_cast<Hotplug*>(self)->changed_ = true;
  return 0;  // 1 would end the registration
}

void Hotplug::run() {
  static_cast<void>(rt::apply_to_this_thread({.name = "bolo-usb-watch"}));
  using Clock = std::chrono::steady_clock;
  Clock::time_point next = Clock::now();
  while (!stop_.load(std::memory_order_relaxed)) {
    if (std::exchange(changed_, false) || (!has_events_ && Clock::now() >= next)) {
      compare();
      next = Clock::now() + kPollPeriod;
    }
    timeval tick = kWatchTick;
    libusb_handle_events_timeout(context_.get(), &tick);
  }
}

// An event only says that something changed: libusb's callback must not perform transfers, and so cannot read strings.
void Hotplug::compare() {
  auto present = list_devices(context_.get(), filter_);
  if (!present) return;
  for (const UsbDevice& device : known_) {
    if (!has(*present, device)) callback_(Change::kLeft, device);
  }
  for (const UsbDevice& device : *present) {
    if (!has(known_, device)) callback_(Change::kArrived, device);
  }
  known_ = std::move(*present);
}

}  // namespace bolo::usb

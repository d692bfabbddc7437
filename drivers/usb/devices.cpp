#include "drivers/usb/devices.hpp"

#include <sys/time.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <chrono>
#include <span>
#include <tuple>
#include <utility>

#include <fmt/format.h>

#include "src/core/input_file.hpp"
#include "src/core/text.hpp"
#include "src/rt/thread.hpp"

namespace bolo::usb {
namespace {

struct FreeConfig {
  void operator()(libusb_config_descriptor* config) const noexcept { libusb_free_config_descriptor(config); }
};
using Config = std::unique_ptr<libusb_config_descriptor, FreeConfig>;

using Bytes = std::span<const unsigned char>;

using Names = std::span<const std::pair<int, std::string_view>>;
std::string_view name_in(Names names, int number, std::string_view otherwise = "unknown") {
  const auto found = std::ranges::find(names, number, &Names::value_type::first);
  return found != names.end() ? found->second : otherwise;
}

// USB-IF, "Defined Class Codes".
constexpr std::pair<int, std::string_view> kClasses[]{{LIBUSB_CLASS_PER_INTERFACE, "told by the interfaces"},
                                                      {LIBUSB_CLASS_AUDIO, "audio"},
                                                      {LIBUSB_CLASS_COMM, "communications"},
                                                      {LIBUSB_CLASS_HID, "human interface"},
                                                      {LIBUSB_CLASS_PHYSICAL, "physical"},
                                                      {LIBUSB_CLASS_IMAGE, "still image (PTP)"},
                                                      {LIBUSB_CLASS_PRINTER, "printer"},
                                                      {LIBUSB_CLASS_MASS_STORAGE, "mass storage"},
                                                      {LIBUSB_CLASS_HUB, "hub"},
                                                      {LIBUSB_CLASS_DATA, "communications data"},
                                                      {LIBUSB_CLASS_SMART_CARD, "smart card"},
                                                      {LIBUSB_CLASS_CONTENT_SECURITY, "content security"},
                                                      {LIBUSB_CLASS_VIDEO, "video (UVC)"},
                                                      {LIBUSB_CLASS_PERSONAL_HEALTHCARE, "personal healthcare"},
                                                      {LIBUSB_CLASS_DIAGNOSTIC_DEVICE, "diagnostic device"},
                                                      {LIBUSB_CLASS_WIRELESS, "wireless controller, RNDIS"},
                                                      {LIBUSB_CLASS_MISCELLANEOUS, "miscellaneous, USB3 Vision"},
                                                      {LIBUSB_CLASS_APPLICATION, "application specific"},
                                                      {LIBUSB_CLASS_VENDOR_SPEC, "vendor specific"}};

// Table 10-12 of USB 3.2 (9.6.2, device capability type codes).
constexpr std::pair<int, std::string_view> kCapabilities[]{{1, "wireless USB"},
                                                           {LIBUSB_BT_USB_2_0_EXTENSION, "USB 2.0 extension"},
                                                           {LIBUSB_BT_SS_USB_DEVICE_CAPABILITY, "SuperSpeed"},
                                                           {LIBUSB_BT_CONTAINER_ID, "container id"},
                                                           {5, "platform"},
                                                           {6, "power delivery"},
                                                           {10, "SuperSpeedPlus"}};

constexpr std::pair<int, std::string_view> kSpeeds[]{{LIBUSB_SPEED_LOW, "1.5 Mbit/s"},
                                                     {LIBUSB_SPEED_FULL, "12 Mbit/s"},
                                                     {LIBUSB_SPEED_HIGH, "480 Mbit/s"},
                                                     {LIBUSB_SPEED_SUPER, "5 Gbit/s"},
                                                     {LIBUSB_SPEED_SUPER_PLUS, "10 Gbit/s"}};

std::string_view transfer_name(unsigned attributes) {
  constexpr std::array<std::string_view, 4> kNames{"control", "isochronous", "bulk", "interrupt"};
  return kNames[attributes & LIBUSB_TRANSFER_TYPE_MASK];
}

// Indented lines of text, with the strings that descriptors refer to.
class Page {
 public:
  explicit Page(libusb_device_handle* handle) : handle_(handle) {}

  template <typename... Values>
  void line(int depth, fmt::format_string<Values...> pattern, Values&&... values) {
    text_.append(2 * static_cast<std::size_t>(depth), ' ');
    text_ += fmt::format(pattern, std::forward<Values>(values)...) + "\n";
  }

  void string(int depth, const char* name, std::uint8_t index) {
    if (index == 0) return;
    std::array<unsigned char, 256> text{};
    if (handle_ == nullptr) return line(depth, "{:<18} string {}, not read: no permission", name, index);
    const int size = libusb_get_string_descriptor_ascii(handle_, index, text.data(), static_cast<int>(text.size()) - 1);
    if (size < 0) return line(depth, "{:<18} string {}, not read: {}", name, index, reason(size));
    line(depth, "{:<18} \"{}\"", name, reinterpret_cast<const char*>(text.data()));
  }

  void hex(int depth, const char* name, Bytes bytes) {
    constexpr std::size_t kPerLine = 32;
    for (std::size_t at = 0; at < bytes.size(); at += kPerLine) {
      const Bytes part = bytes.subspan(at, std::min(kPerLine, bytes.size() - at));
      line(depth, "{:<18} {:02x}", at == 0 ? name : "", fmt::join(part.begin(), part.end(), " "));
    }
  }

  std::string take() { return std::move(text_); }

 private:
  libusb_device_handle* handle_;  // null: the device cannot be opened
  std::string text_;
};

// Class-specific descriptors in sequence; each begins with its length.
void put_extra(Page& page, int depth, const unsigned char* extra, int length) {
  Bytes left(extra, length > 0 ? static_cast<std::size_t>(length) : 0);
  while (!left.empty()) {
    const std::size_t size = left[0] >= 2 && left[0] <= left.size() ? left[0] : left.size();
    page.hex(depth, "class specific", left.first(size));
    left = left.subspan(size);
  }
}

void put_endpoint(Page& page, const libusb_endpoint_descriptor& endpoint) {
  const bool in = (endpoint.bEndpointAddress & LIBUSB_ENDPOINT_DIR_MASK) == LIBUSB_ENDPOINT_IN;
  // Bits 12..11 of a high-speed periodic endpoint: additional transactions per microframe (USB 2.0, table 9-13).
  const unsigned packet = endpoint.wMaxPacketSize & 0x7FFU;
  const unsigned transactions = 1 + ((endpoint.wMaxPacketSize >> 11) & 3U);
  page.line(3, "endpoint 0x{:02x}: {} {}, packets of {} bytes x {}, interval {}", endpoint.bEndpointAddress,
            transfer_name(endpoint.bmAttributes), in ? "in" : "out", packet, transactions, endpoint.bInterval);
  put_extra(page, 4, endpoint.extra, endpoint.extra_length);
}

void put_interface(Page& page, const libusb_interface_descriptor& setting) {
  page.line(
      2, "interface {}, alternate setting {}: class 0x{:02x} ({}), subclass 0x{:02x}, protocol 0x{:02x}, {} endpoints",
      setting.bInterfaceNumber, setting.bAlternateSetting, setting.bInterfaceClass,
      name_in(kClasses, setting.bInterfaceClass), setting.bInterfaceSubClass, setting.bInterfaceProtocol,
      setting.bNumEndpoints);
  page.string(3, "name", setting.iInterface);
  put_extra(page, 3, setting.extra, setting.extra_length);
  for (const auto& endpoint : std::span(setting.endpoint, setting.bNumEndpoints)) put_endpoint(page, endpoint);
}

void put_configuration(Page& page, libusb_device* device, std::uint8_t index, bool superspeed) {
  libusb_config_descriptor* given = nullptr;
  const bool is_given = libusb_get_config_descriptor(device, index, &given) == 0;
  const Config config(is_given ? given : nullptr);
  if (config == nullptr) return page.line(1, "configuration {}: not given", index);
  page.line(1, "configuration {}: attributes 0x{:02x}{}{}, at most {} mA, {} interfaces", config->bConfigurationValue,
            config->bmAttributes, (config->bmAttributes & 0x40U) != 0 ? ", self-powered" : "",
            (config->bmAttributes & 0x20U) != 0 ? ", remote wake-up" : "",
            static_cast<unsigned>(config->MaxPower) * (superspeed ? 8U : 2U), config->bNumInterfaces);
  page.string(2, "name", config->iConfiguration);
  put_extra(page, 2, config->extra, config->extra_length);
  for (const auto& interface : std::span(config->interface, config->bNumInterfaces)) {
    for (int i = 0; i < interface.num_altsetting; ++i) put_interface(page, interface.altsetting[i]);
  }
}

// Binary device object store: capabilities of devices from USB 2.1 on.
void put_bos(Page& page, libusb_device_handle* handle, std::uint16_t usb_release) {
  constexpr std::uint16_t kFirstWithBos = 0x0201;
  if (usb_release < kFirstWithBos) return page.line(1, "BOS: none before USB 2.01");
  if (handle == nullptr) return page.line(1, "BOS: not read: no permission");
  libusb_bos_descriptor* bos = nullptr;
  if (const int code = libusb_get_bos_descriptor(handle, &bos); code != 0) {
    return page.line(1, "BOS: not given: {}", reason(code));
  }
  page.line(1, "BOS: {} capabilities", bos->bNumDeviceCaps);
  for (int i = 0; i < bos->bNumDeviceCaps; ++i) {
    const libusb_bos_dev_capability_descriptor& one = *bos->dev_capability[i];
    page.line(2, "capability 0x{:02x} ({})", one.bDevCapabilityType, name_in(kCapabilities, one.bDevCapabilityType));
    constexpr std::size_t kHead = 3;  // length, type, capability
    if (one.bLength > kHead) page.hex(3, "data", Bytes(one.dev_capability_data, one.bLength - kHead));
  }
  libusb_free_bos_descriptor(bos);
}

void put_device(Page& page, const UsbDevice& known, const libusb_device_descriptor& d) {
  page.line(0, "USB device {} at bus {} address {}, port {}, {}", id_text(d.idVendor, d.idProduct), known.bus,
            known.address, known.port_path, known.speed);
  page.line(1, "{:<18} \"{}\"", "manufacturer", known.manufacturer);
  page.line(1, "{:<18} \"{}\"", "product", known.product_name);
  page.line(1, "{:<18} \"{}\"", "serial number", known.serial);
  page.line(1, "{:<18} {:x}.{:02x}", "USB release", d.bcdUSB >> 8, d.bcdUSB & 0xFFU);
  page.line(1, "{:<18} {:x}.{:02x}", "device release", d.bcdDevice >> 8, d.bcdDevice & 0xFFU);
  page.line(1, "{:<18} 0x{:02x} ({}), subclass 0x{:02x}, protocol 0x{:02x}", "class", d.bDeviceClass,
            name_in(kClasses, d.bDeviceClass), d.bDeviceSubClass, d.bDeviceProtocol);
  page.line(1, "{:<18} {} bytes", "control packets", d.bMaxPacketSize0);
  page.line(1, "{:<18} {}", "configurations", d.bNumConfigurations);
}

std::string report_of(libusb_device* device) {
  const UsbDevice known = describe(device);
  libusb_device_descriptor descriptor{};
  libusb_get_device_descriptor(device, &descriptor);
  libusb_device_handle* opened = nullptr;
  const int code = libusb_open(device, &opened);
  const Handle handle(code == 0 ? opened : nullptr);
  Page page(handle.get());
  put_device(page, known, descriptor);
  if (code != 0) page.line(1, "{:<18} {}: {}", "not opened", known.node, reason(code));
  const bool superspeed = libusb_get_device_speed(device) >= LIBUSB_SPEED_SUPER;
  for (std::uint8_t i = 0; i < descriptor.bNumConfigurations; ++i) put_configuration(page, device, i, superspeed);
  put_bos(page, handle.get(), descriptor.bcdUSB);
  return page.take();
}

// USB 3 allows hubs seven levels deep.
constexpr int kMostPorts = 7;

std::string port_path(libusb_device* device) {
  const int bus = libusb_get_bus_number(device);
  std::array<std::uint8_t, kMostPorts> ports{};
  const int count = libusb_get_port_numbers(device, ports.data(), kMostPorts);
  if (count <= 0) return "usb" + std::to_string(bus);
  return fmt::format("{}-{}", bus, fmt::join(ports.begin(), ports.begin() + count, "."));
}

// As read by the kernel when the device was connected.
std::string kernel_string(const std::string& port_path, const char* name) {
  return first_line("/sys/bus/usb/devices/" + port_path + "/" + name);
}

std::string device_string(libusb_device_handle* handle, std::uint8_t index) {
  std::array<unsigned char, 256> text{};
  const int size = libusb_get_string_descriptor_ascii(handle, index, text.data(), static_cast<int>(text.size()));
  return size > 0 ? std::string(text.data(), text.data() + size) : std::string();
}

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

constexpr timeval kWatchTick{0, 50'000};
constexpr std::chrono::milliseconds kPollPeriod(300);

// Same device and same connection: a replugged device gets a new address.
bool same(const UsbDevice& a, const UsbDevice& b) {
  return a.bus == b.bus && a.address == b.address && a.vendor == b.vendor && a.product == b.product;
}

bool has(const std::vector<UsbDevice>& devices, const UsbDevice& device) {
  return std::any_of(devices.begin(), devices.end(), [&](const UsbDevice& d) { return same(d, device); });
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
  DeviceFilter filter;
  if (text.size() == 2 * kDigits + 1 && text[kDigits] == ':') {
    filter.vendor = whole_number<std::uint16_t>(text.substr(0, kDigits), 16);
    filter.product = whole_number<std::uint16_t>(text.substr(kDigits + 1), 16);
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
  found.speed = name_in(kSpeeds, libusb_get_device_speed(device), "unknown speed");
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
    // describe() may open the device: skip those of other vendors.
    if (filter.vendor.value_or(ids.idVendor) != ids.idVendor) continue;
    if (UsbDevice one = describe(device); filter.matches(one)) found.push_back(std::move(one));
  }
  std::sort(found.begin(), found.end(), [](const UsbDevice& a, const UsbDevice& b) {
    return std::tie(a.bus, a.address) < std::tie(b.bus, b.address);
  });
  return found;
}

Result<std::vector<UsbDevice>> list_devices(const DeviceFilter& filter) {
  ASSIGN_OR_RETURN(const auto context, make_context());
  return list_devices(context.get(), filter);
}

Result<std::string> descriptor_report(const DeviceFilter& filter) {
  ASSIGN_OR_RETURN(const auto context, make_context());
  const DeviceList devices(context.get());
  if (devices.error() != 0) return failed("USB: devices cannot be listed: " + reason(devices.error()));
  std::string reports;
  for (libusb_device* device : devices) {
    if (!filter.matches(describe(device))) continue;
    reports += (reports.empty() ? "" : "\n") + report_of(device);
  }
  if (reports.empty()) return bad_input("no " + filter.text() + " is connected; `bolo usb --vendor any` lists all");
  return reports;
}

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
  return 0;  // 1 would deregister the callback
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

// Compares whole lists, because libusb's callback must not perform transfers and so cannot read strings.
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

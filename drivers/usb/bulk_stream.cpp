#include "drivers/usb/bulk_stream.hpp"

#include <sys/time.h>

#include <array>
#include <cstdio>
#include <span>
#include <utility>

#include "src/core/clock.hpp"

namespace bolo::usb {
namespace {

constexpr unsigned kControlTimeoutMs = 1000;
constexpr std::int64_t kTakeBackLimitNs = 2'000'000'000;
constexpr timeval kTick{0, 20'000};
// Packed frames come in transfers of this size, so that a frame is complete soon after its last byte.
constexpr std::size_t kPackedTransferBytes = 16384;

std::string hex(unsigned value) {
  std::array<char, 16> text{};
  std::snprintf(text.data(), text.size(), "0x%02x", value);
  return text.data();
}

DeviceFilter filter_of(const UsbOptions& options) {
  return {.vendor = options.vendor, .product = options.product, .bus = {}, .address = {}, .serial = options.serial};
}

// The one device that is meant, opened.
Result<std::pair<UsbDevice, Handle>> open_device(libusb_context* context, const UsbOptions& options) {
  const DeviceFilter filter = filter_of(options);
  const DeviceList devices(context);
  if (devices.error() != 0) return failed("USB: devices cannot be listed: " + reason(devices.error()));
  libusb_device* meant = nullptr;
  UsbDevice known;
  for (libusb_device* device : devices) {
    UsbDevice one = describe(device);
    if (!filter.matches(one)) continue;
    if (meant != nullptr) {
      return bad_input("several of " + filter.text() + " are connected; give the serial number (`bolo usb`)");
    }
    meant = device;
    known = std::move(one);
  }
  if (meant == nullptr) return bad_input("no " + filter.text() + " is connected; `bolo usb` lists what is");
  libusb_device_handle* handle = nullptr;
  const int code = libusb_open(meant, &handle);
  if (code == LIBUSB_ERROR_ACCESS) {
    return bad_input(filter.text() + " may not be opened by this user: install systemd/60-bolo-usb.rules and join " +
                     "the group video, or open " + known.node + " as root");
  }
  if (code != 0) return bad_input(filter.text() + " cannot be opened: " + reason(code));
  return std::pair(std::move(known), Handle(handle));
}

// Bytes of the endpoint's packets; 0: the device has no such bulk endpoint there.
std::size_t packet_bytes(libusb_device* device, const UsbOptions& options) {
  libusb_config_descriptor* active = nullptr;
  if (libusb_get_active_config_descriptor(device, &active) != 0) return 0;
  const Config config(active);
  for (const auto& interface : std::span(config->interface, config->bNumInterfaces)) {
    for (const auto& setting : std::span(interface.altsetting, static_cast<std::size_t>(interface.num_altsetting))) {
      if (setting.bInterfaceNumber != options.interface || setting.bAlternateSetting != options.alternate_setting) {
        continue;
      }
      for (const auto& endpoint : std::span(setting.endpoint, setting.bNumEndpoints)) {
        const bool bulk = (endpoint.bmAttributes & LIBUSB_TRANSFER_TYPE_MASK) == LIBUSB_TRANSFER_TYPE_BULK;
        if (endpoint.bEndpointAddress == options.endpoint && bulk) return endpoint.wMaxPacketSize;
      }
    }
  }
  return 0;
}

// Whole packets, lest the last one overflows. A frame that ends with a short packet gets room for more than itself:
// then a full transfer holds a frame that is too long.
std::size_t transfer_bytes(const FrameLayout& layout, std::size_t packet) {
  const std::size_t wanted = layout.framing == Framing::kPacked ? kPackedTransferBytes - 1 : layout.frame_bytes();
  return (wanted / packet + 1) * packet;
}

}  // namespace

Result<std::unique_ptr<BulkStream>> BulkStream::open(libusb_context* context, const UsbOptions& options) {
  auto opened = open_device(context, options);
  if (!opened) return tl::unexpected<Error>(opened.error());
  std::unique_ptr<BulkStream> stream(
      new BulkStream(context, options, std::move(opened->first), std::move(opened->second)));
  if (Status claimed = stream->claim(); !claimed) return tl::unexpected<Error>(claimed.error());
  if (Status prepared = stream->prepare(); !prepared) return tl::unexpected<Error>(prepared.error());
  return stream;
}

BulkStream::BulkStream(libusb_context* context, const UsbOptions& options, UsbDevice device, Handle handle)
    : context_(context), options_(options), device_(std::move(device)), handle_(std::move(handle)) {}

BulkStream::~BulkStream() {
  if (begun_ && trouble_ != Trouble::kGone) {
    for (const ControlRequest& request : options_.stop) static_cast<void>(send(request));
  }
  take_back();
  if (claimed_) libusb_release_interface(handle_.get(), options_.interface);
  handle_.reset();  // forgets transfers that did not come back, so that they can be freed
}

Status BulkStream::claim() {
  libusb_set_auto_detach_kernel_driver(handle_.get(), 1);  // where the system can; claiming says when it matters
  const std::string where = filter_of(options_).text() + ", interface " + std::to_string(options_.interface);
  const int code = libusb_claim_interface(handle_.get(), options_.interface);
  if (code == LIBUSB_ERROR_BUSY) return bad_input(where + ": another program has it; end that one");
  if (code != 0) return bad_input(where + ": cannot be claimed: " + reason(code));
  claimed_ = true;
  // Also where it is set already: this clears the endpoints' halts.
  const int set = libusb_set_interface_alt_setting(handle_.get(), options_.interface, options_.alternate_setting);
  if (set == 0) return {};
  return bad_input(where + ": alternate setting " + std::to_string(options_.alternate_setting) + ": " + reason(set));
}

Status BulkStream::prepare() {
  const std::size_t packet = packet_bytes(libusb_get_device(handle_.get()), options_);
  if (packet == 0) {
    return bad_input(filter_of(options_).text() + ": interface " + std::to_string(options_.interface) +
                     ", alternate setting " + std::to_string(options_.alternate_setting) + " has no bulk endpoint " +
                     hex(options_.endpoint) + "; `bolo usb --report` lists those it has");
  }
  const std::size_t bytes = transfer_bytes(options_.layout, packet);
  const std::size_t per_frame = (options_.layout.frame_bytes() + bytes - 1) / bytes;
  slots_.resize(static_cast<std::size_t>(options_.transfers) * per_frame);
  for (Slot& slot : slots_) {
    slot.owner = this;
    slot.buffer.resize(bytes);
    slot.transfer.reset(libusb_alloc_transfer(0));
    if (slot.transfer == nullptr) return failed("USB: no memory for a transfer");
    libusb_fill_bulk_transfer(slot.transfer.get(), handle_.get(), options_.endpoint, slot.buffer.data(),
                              static_cast<int>(bytes), &on_transfer, &slot, 0);
  }
  return {};
}

Status BulkStream::begin(Intake& intake) {
  intake_ = &intake;
  if (Status submitted = submit_all(); !submitted) return submitted;
  begun_ = true;
  for (const ControlRequest& request : options_.start) {
    if (Status sent = send(request); !sent) return sent;
  }
  return {};
}

Status BulkStream::submit_all() {
  for (Slot& slot : slots_) {
    submit(slot);
    if (!slot.under_way)
      return failed(filter_of(options_).text() + ": transfers cannot be submitted; is " +
                    "/sys/module/usbcore/parameters/usbfs_memory_mb large enough?");
  }
  return {};
}

Status BulkStream::send(const ControlRequest& request) {
  std::vector<std::uint8_t> data = request.data;
  const int code =
      libusb_control_transfer(handle_.get(), request.request_type, request.request, request.value, request.index,
                              data.data(), static_cast<std::uint16_t>(data.size()), kControlTimeoutMs);
  if (code >= 0) return {};
  return failed(filter_of(options_).text() + ": control request " + hex(request.request) + " with value " +
                hex(request.value) + ": " + reason(code));
}

Status BulkStream::recover() {
  take_back();
  if (under_way_ > 0) return failed(filter_of(options_).text() + ": transfers do not come back");
  if (trouble_ == Trouble::kGone) return failed(filter_of(options_).text() + " was unplugged");
  const int code = libusb_clear_halt(handle_.get(), options_.endpoint);
  if (code != 0) return failed(filter_of(options_).text() + ": the endpoint's halt stays: " + reason(code));
  trouble_ = Trouble::kNone;
  return submit_all();
}

// Handling events meanwhile: each comes back through on_transfer().
void BulkStream::take_back() noexcept {
  taking_back_ = true;
  for (Slot& slot : slots_) {
    if (slot.under_way) libusb_cancel_transfer(slot.transfer.get());
  }
  const std::int64_t limit_ns = monotonic_ns() + kTakeBackLimitNs;
  while (under_way_ > 0 && monotonic_ns() < limit_ns) {
    timeval tick = kTick;
    libusb_handle_events_timeout_completed(context_, &tick, nullptr);
  }
  taking_back_ = false;
}

void BulkStream::submit(Slot& slot) noexcept {
  const int code = libusb_submit_transfer(slot.transfer.get());
  slot.under_way = code == 0;
  under_way_ += slot.under_way ? 1 : 0;
  if (code == LIBUSB_ERROR_NO_DEVICE) {
    trouble_ = Trouble::kGone;
  } else if (code != 0 && trouble_ == Trouble::kNone) {
    trouble_ = Trouble::kHalted;
  }
}

void BulkStream::on_transfer(libusb_transfer* transfer) {
  auto* slot = static_cast<Slot*>(transfer->user_data);
  slot->owner->finish(*slot);
}

void BulkStream::finish(Slot& slot) noexcept {
  slot.under_way = false;
  --under_way_;
  const libusb_transfer& done = *slot.transfer;
  const auto bytes = static_cast<std::size_t>(done.actual_length);
  switch (done.status) {
    case LIBUSB_TRANSFER_COMPLETED:
      intake_->take(std::as_bytes(std::span(done.buffer, bytes)), done.actual_length < done.length);
      break;
    case LIBUSB_TRANSFER_OVERFLOW:
      intake_->overflowed();
      break;
    case LIBUSB_TRANSFER_CANCELLED:
      if (trouble_ == Trouble::kHalted) intake_->failed(bytes);  // else it is us who end the stream
      return;
    case LIBUSB_TRANSFER_NO_DEVICE:
      trouble_ = Trouble::kGone;
      return;
    case LIBUSB_TRANSFER_STALL:
    case LIBUSB_TRANSFER_TIMED_OUT:
    case LIBUSB_TRANSFER_ERROR:
    default:
      if (trouble_ == Trouble::kNone) trouble_ = Trouble::kHalted;
      intake_->failed(bytes);
      return;
  }
  if (!taking_back_ && trouble_ == Trouble::kNone) submit(slot);
}

}  // namespace bolo::usb

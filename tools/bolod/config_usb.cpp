#include "tools/bolod/config_usb.hpp"

#include <array>
#include <charconv>
#include <optional>
#include <sstream>
#include <string_view>
#include <utility>
#include <vector>

namespace bolo::daemon {
namespace {

constexpr std::array<std::pair<std::string_view, usb::Framing>, 2> kFramings{
    {{"short_packet", usb::Framing::kShortPacket}, {"packed", usb::Framing::kPacked}}};
constexpr std::array<std::pair<std::string_view, Unit>, 2> kUnits{{{"kelvin", Unit::kKelvin}, {"count", Unit::kCount}}};

template <typename T>
std::optional<T> hex_number(std::string_view text) {
  T value{};
  const char* const end = text.data() + text.size();
  const auto [read, error] = std::from_chars(text.data(), end, value, 16);
  if (text.empty() || error != std::errc() || read != end) return std::nullopt;
  return value;
}

// "B010" are two bytes.
std::optional<std::vector<std::uint8_t>> hex_bytes(std::string_view text) {
  std::vector<std::uint8_t> bytes;
  if (text.size() % 2 != 0) return std::nullopt;
  for (; !text.empty(); text.remove_prefix(2)) {
    const auto byte = hex_number<std::uint8_t>(text.substr(0, 2));
    if (!byte) return std::nullopt;
    bytes.push_back(*byte);
  }
  return bytes;
}

// "TYPE REQUEST VALUE INDEX [DATA]"
std::optional<usb::ControlRequest> parse_request(const std::string& text) {
  std::istringstream words(text);
  std::array<std::string, 6> word;
  for (std::string& one : word) words >> one;
  const auto type = hex_number<std::uint8_t>(word[0]);
  const auto request = hex_number<std::uint8_t>(word[1]);
  const auto value = hex_number<std::uint16_t>(word[2]);
  const auto index = hex_number<std::uint16_t>(word[3]);
  const auto data = hex_bytes(word[4]);
  if (!type || !request || !value || !index || !data || !word[5].empty()) return std::nullopt;
  return usb::ControlRequest{*type, *request, *value, *index, *data};
}

Result<std::vector<usb::ControlRequest>> parse_requests(const std::string& text) {
  std::vector<usb::ControlRequest> requests;
  std::istringstream all(text);
  for (std::string one; std::getline(all, one, ';');) {
    const auto request = parse_request(one);
    if (!request) {
      return bad_input("'" + one + "' is not TYPE REQUEST VALUE INDEX [DATA] in hexadecimal, as 40 51 0001 0000 0a0b");
    }
    requests.push_back(*request);
  }
  return requests;
}

void frame_keys(model::KeyTable& keys, UsbKeys& usb) {
  usb::FrameLayout& layout = usb.options.layout;
  keys.choice<usb::Framing>(
      "framing", layout.framing, kFramings,
      "What ends a frame. short_packet: a packet that is not full, or empty. packed: frames follow "
      "one another without a break.");
  keys.integer("header_bytes", usb.header_bytes, {0, 1 << 20, "bytes"}, "Before each frame's pixels.");
  keys.text("magic", usb.magic, "What each header begins with, two hexadecimal digits a byte; empty: not known.");
  keys.integer("counter_offset", usb.counter_offset, {0, 1 << 20, "bytes"},
               "Where in the header a number lies that grows by one a frame.");
  keys.integer("counter_bytes", usb.counter_bytes, {0, 8, "bytes"}, "Its size: 1, 2, 4 or 8; 0: there is none.");
  keys.boolean("counter_big_endian", usb.counter_big_endian, "Its most significant byte comes first.");
  keys.integer("trailer_bytes", usb.trailer_bytes, {0, 1 << 20, "bytes"}, "After each frame's pixels.");
  keys.choice<Unit>("unit", usb.options.scale.unit, kUnits, "What a pixel's value means.");
  keys.number("scale", usb.options.scale.scale, {1e-9, 1e3, "K"}, "kelvin = scale * value + offset.");
  keys.number("offset", usb.options.scale.offset, {-1e4, 1e4, "K"}, "See scale.");
}

}  // namespace

void usb_keys(model::KeyTable& keys, UsbKeys& usb) {
  keys.section("usb", "experimental: frames over a bulk endpoint, tried with an emulated camera only");
  keys.text("device", usb.device, "VENDOR:PRODUCT, as `bolo usb` lists them: 09cb:1007.");
  keys.integer("interface", usb.options.interface, {0, 255, ""}, "Interface; `bolo usb --report` lists them.");
  keys.integer("alternate_setting", usb.options.alternate_setting, {0, 255, ""}, "Its setting with the endpoint.");
  keys.integer("endpoint", usb.endpoint, {129, 143, ""}, "Address of the bulk endpoint to the host: 129 is 0x81.");
  keys.integer("transfers", usb.options.transfers, {1, 64, "frames"}, "Frames that the host may be late.");
  keys.text("start", usb.start,
            "Control requests that start the stream: TYPE REQUEST VALUE INDEX [DATA] in hexadecimal, with ; between.");
  keys.text("stop", usb.stop, "Those that end it.");
  frame_keys(keys, usb);
}

Result<usb::UsbOptions> usb_options(const model::KeyTable& keys, const UsbKeys& usb,
                                    const genicam::CameraOptions& camera) {
  const auto here = [&keys](const char* key, const std::string& message) {
    return bad_input(keys.where(std::string("usb.") + key) + "usb." + key + ": " + message);
  };
  usb::UsbOptions options = usb.options;
  const auto ids = usb::parse_ids(usb.device);
  if (!ids) return here("device", ids.error().message);
  options.vendor = *ids->vendor;
  options.product = *ids->product;
  options.serial = camera.serial;
  options.endpoint = static_cast<std::uint8_t>(usb.endpoint);
  auto start = parse_requests(usb.start);
  if (!start) return here("start", start.error().message);
  auto stop = parse_requests(usb.stop);
  if (!stop) return here("stop", stop.error().message);
  options.start = std::move(*start);
  options.stop = std::move(*stop);

  const auto magic = hex_bytes(usb.magic);
  if (!magic) return here("magic", "'" + usb.magic + "' is not bytes of two hexadecimal digits each, as b010");
  for (const std::uint8_t byte : *magic) options.layout.magic.push_back(std::byte{byte});
  options.layout.geometry = {camera.width, camera.height};
  options.layout.header_bytes = static_cast<std::size_t>(usb.header_bytes);
  options.layout.trailer_bytes = static_cast<std::size_t>(usb.trailer_bytes);
  options.layout.big_endian_pixels = camera.pixel_order == genicam::PixelOrder::kBigEndian;
  if (usb.counter_bytes != 0) {
    options.layout.counter = usb::CounterField{static_cast<std::size_t>(usb.counter_offset),
                                               static_cast<std::size_t>(usb.counter_bytes), usb.counter_big_endian};
  }
  if (const Status layout = usb::check(options.layout); !layout) return here("header_bytes", layout.error().message);
  if (!(camera.rate_hz > 0.0)) return here("device", "a USB camera does not tell its rate; give source.rate_hz");
  options.frame_period_s = 1.0 / camera.rate_hz;
  options.realtime_priority = camera.realtime_priority;
  options.stall_ms = camera.stall_ms;
  options.reconnect_after_ms = camera.reconnect_after_ms;
  return options;
}

}  // namespace bolo::daemon

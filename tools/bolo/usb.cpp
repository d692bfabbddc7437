// `bolo usb`: lists, describes and watches USB cameras.
#include <chrono>
#include <cstdio>
#include <string>
#include <string_view>
#include <thread>
#include <utility>

#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include "drivers/usb/devices.hpp"
#include "src/core/text.hpp"
#include "tools/bolo/verbs.hpp"
#include "tools/cli/cli.hpp"

namespace bolo::tools {
namespace {

using Json = nlohmann::ordered_json;
using usb::UsbDevice;

// Ids have four digits each, so 1:4 can only be BUS:ADDRESS.
Result<usb::DeviceFilter> parse_device(const std::string& text) {
  if (auto ids = usb::parse_ids(text)) return ids;
  const std::size_t colon = text.find(':');
  if (colon != std::string::npos) {
    usb::DeviceFilter filter;
    filter.bus = whole_number<int>(std::string_view(text).substr(0, colon));
    filter.address = whole_number<int>(std::string_view(text).substr(colon + 1));
    if (filter.bus && filter.address) return filter;
  }
  return bad_input("--device " + text + ": give BUS:ADDRESS as 1:4, or VENDOR:PRODUCT as 09cb:1007");
}

Result<usb::DeviceFilter> filter_of(const cxxopts::ParseResult& given) {
  if (given.count("device") != 0) return parse_device(given["device"].as<std::string>());
  usb::DeviceFilter filter;
  const auto vendor = given["vendor"].as<std::string>();
  if (vendor == "any") return filter;
  filter.vendor = whole_number<std::uint16_t>(vendor, 16);
  if (!filter.vendor) return bad_input("--vendor " + vendor + ": give four hexadecimal digits as 09cb, or any");
  return filter;
}

Json to_json(const UsbDevice& device) {
  return {{"bus", device.bus},
          {"address", device.address},
          {"port", device.port_path},
          {"id", usb::id_text(device.vendor, device.product)},
          {"speed", device.speed},
          {"manufacturer", device.manufacturer},
          {"product", device.product_name},
          {"serial", device.serial},
          {"node", device.node},
          {"allowed", device.allowed}};
}

std::string line_of(const UsbDevice& device) {
  std::string line = fmt::format("{}:{}  port {}  {}  {}", device.bus, device.address, device.port_path,
                                 usb::id_text(device.vendor, device.product), device.speed);
  for (const std::string* text : {&device.manufacturer, &device.product_name}) {
    if (!text->empty()) line += "  " + *text;
  }
  if (!device.serial.empty()) line += "  serial " + device.serial;
  if (!device.allowed)
    line += "  (not allowed to open " + device.node + ": join the group video; see 60-bolo-usb.rules)";
  return printable(line);
}

Status list(const usb::DeviceFilter& filter, bool as_json) {
  ASSIGN_OR_RETURN(const auto devices, usb::list_devices(filter));
  if (as_json) {
    Json all = Json::array();
    for (const UsbDevice& device : devices) all.push_back(to_json(device));
    std::puts(json_text(Json{{"devices", std::move(all)}}, 2).c_str());
    return {};
  }
  for (const UsbDevice& device : devices) std::puts(line_of(device).c_str());
  if (devices.empty()) std::printf("no %s is connected\n", filter.text().c_str());
  return {};
}

Status print_descriptors(const usb::DeviceFilter& filter, bool as_json) {
  ASSIGN_OR_RETURN(const auto text, usb::descriptor_report(filter));
  std::fputs((as_json ? json_text(Json{{"report", text}}, 2) + "\n" : text).c_str(), stdout);
  return {};
}

Status watch(const usb::DeviceFilter& filter, bool as_json) {
  catch_interrupts();
  const auto print = [as_json](usb::Hotplug::Change change, const UsbDevice& device) {
    const bool arrived = change == usb::Hotplug::Change::kArrived;
    const Json event{{"event", arrived ? "arrived" : "left"}, {"device", to_json(device)}};
    std::puts(as_json ? json_text(event).c_str() : ((arrived ? "arrived  " : "left     ") + line_of(device)).c_str());
    std::fflush(stdout);
  };
  ASSIGN_OR_RETURN(const auto hotplug, usb::Hotplug::start(filter, print));
  while (!interrupted() && std::ferror(stdout) == 0) std::this_thread::sleep_for(std::chrono::milliseconds(50));
  return {};
}

Status run_usb(const cxxopts::ParseResult& given) {
  const bool as_json = given.count("json") != 0;
  if (given.count("report") != 0 && given.count("watch") != 0) {
    return bad_input("--report and --watch exclude each other; give one");
  }
  ASSIGN_OR_RETURN(const auto filter, filter_of(given));
  if (given.count("report") != 0) return print_descriptors(filter, as_json);
  return given.count("watch") != 0 ? watch(filter, as_json) : list(filter, as_json);
}

}  // namespace

int usb_main(int argc, char** argv) {
  cxxopts::Options options("bolo usb", "List FLIR's USB devices and their descriptors. Experimental.");
  add_option<std::string>(options, "vendor", "Vendor id, four hexadecimal digits, or any", "09cb", "ID");
  add_option<std::string>(options, "device", "Only this device, by place or ids", nullptr,
                          "BUS:ADDRESS|VENDOR:PRODUCT");
  add_option<bool>(options, "report", "Print all descriptors, for support");
  add_option<bool>(options, "watch", "Print arrivals and departures until interrupted");
  add_option<bool>(options, "json", "Print as JSON");
  return run_verb("usb", std::move(options), argc, argv, run_usb, false);
}

}  // namespace bolo::tools

#include "drivers/genicam/connection.hpp"

#include <algorithm>
#include <array>
#include <chrono>
#include <cstdint>
#include <optional>
#include <span>
#include <utility>

#include <fmt/format.h>

#include "drivers/genicam/aravis_limits.hpp"
#include "drivers/genicam/description.hpp"
#include "drivers/genicam/nodes.hpp"

namespace bolo::genicam {
namespace {

std::string safe(const char* text) { return text != nullptr ? text : ""; }

constexpr std::uint64_t kPrivilegeRegister = 0x0A00;  // GigE Vision: control channel privilege
constexpr std::uint32_t kControlled = 0x3;            // exclusive access, or control access
constexpr std::uint64_t kSerialRegister = 0x00D8;     // GigE Vision: serial number, text
constexpr std::uint32_t kSerialBytes = 16;
constexpr std::chrono::seconds kReadingLimit(30);  // for reading a description; after that bolod counts as hanging

// Lists only the first cameras: forged answers may name thousands.
std::string list_of(const std::vector<FoundCamera>& cameras) {
  constexpr std::size_t kMostListed = 8;
  const auto listed = std::span(cameras).first(std::min(cameras.size(), kMostListed));
  std::string text;
  for (const FoundCamera& f : listed) text += (text.empty() ? "" : ", ") + f.id + " at " + f.address;
  if (listed.size() < cameras.size()) text += fmt::format(" and {} more", cameras.size() - listed.size());
  return text;
}

Result<FoundCamera> choose_camera(const std::string& id, const std::string& serial) {
  const std::vector<FoundCamera> cameras = find_cameras();
  if (cameras.empty()) {
    return bad_input(
        "no camera answers: check its power and cable, that this computer has an address in its subnet, and that no "
        "firewall drops UDP port 3956; or give its address");
  }
  if (id.empty() && !serial.empty()) {
    for (const FoundCamera& f : cameras) {
      if (f.serial == serial) return f;
    }
    return bad_input("no camera with serial number '" + serial + "' answers; found: " + list_of(cameras));
  }
  if (id.empty()) {
    if (cameras.size() == 1) return cameras.front();
    return bad_input("several cameras answer (" + list_of(cameras) + "): give the address of one");
  }
  for (const FoundCamera& f : cameras) {
    if (f.id == id || f.address == id) return f;
  }
  return bad_input("no camera named '" + id + "' answers; found: " + list_of(cameras));
}

// Releases the device if its description is unsafe to evaluate.
Status check_device(Connection& connection) {
  Status good = check_description(arv_device_get_genicam(connection.device.get()));
  if (good) return good;
  connection.device.reset();
  return bad_input(connection.name + ": " + good.error().message);
}

// Opens the device at the connection's address, as its controller unless another program is.
Status open_device(Connection& connection) {
  const Ref<GInetAddress> local(g_inet_address_new_from_string(connection.route.local_address.c_str()));
  const Ref<GInetAddress> remote(g_inet_address_new_from_string(connection.address.c_str()));
  GlibError error;
  connection.device.reset();
  connection.device.reset(arv_gv_device_new(local.get(), remote.get(), error.out()));
  if (!error && connection.device != nullptr) return check_device(connection);
  connection.device.reset();
  return failed(connection.name + " answers but cannot be opened (" + error.message() + ")");
}

bool is_controller(const Connection& connection) {
  return arv_gv_device_is_controller(ARV_GV_DEVICE(connection.device.get())) == TRUE;
}

Result<Connection> open_gige(const std::string& ipv4) {
  Connection connection;
  connection.name = "camera " + ipv4;
  connection.address = ipv4;
  ASSIGN_OR_RETURN(connection.route, route_to(ipv4));
  if (!answers_gvcp(ipv4)) {
    return bad_input("no camera answers at " + ipv4 + " through " + connection.route.interface + " (" +
                     connection.route.local_address +
                     "): check its power and cable, its address, and that no firewall drops UDP port 3956");
  }
  const auto until = std::chrono::steady_clock::now() + kReadingLimit;
  const Status taken = take_description([&](std::uint32_t address, std::uint32_t bytes) {
    return std::chrono::steady_clock::now() < until ? read_memory(ipv4, address, bytes) : std::nullopt;
  });
  if (!taken) return at(connection.name, taken.error());
  RETURN_IF_ERROR(open_device(connection));
  if (!is_controller(connection) && free_from_dead_program(ipv4, connection.route.local_address)) {
    RETURN_IF_ERROR(open_device(connection));
  }
  if (!is_controller(connection)) {
    return bad_input("camera " + ipv4 +
                     " is controlled by another program: end that program; a crashed one lets go after about 3 s");
  }
  return connection;
}

Result<Connection> open_by_id(const std::string& id) {
  GlibError error;
  Connection connection;
  connection.name = "camera " + id;
  {
    const SearchLimit limit;
    connection.device.reset(arv_open_device(id.c_str(), error.out()));
  }
  if (error || connection.device == nullptr) {
    connection.device.reset();
    return bad_input("camera " + id + " cannot be opened (" + error.message() +
                     "): check that no other program uses it and that you may access the device");
  }
  RETURN_IF_ERROR(check_device(connection));
  return connection;
}

// Some FLIR cameras describe registers in an older schema's byte order: 640 columns read as 2147614720 (swapped).
bool has_swapped_registers(ArvDevice* device) {
  GlibError error;
  const auto width = arv_device_get_integer_feature_value(device, "Width", error.out());
  if (error || width < (1 << 16)) return false;
  return __builtin_bswap32(static_cast<std::uint32_t>(width)) < (1U << 16);
}

// Makes Aravis use the older schema's byte order. Call before any node is read.
void use_legacy_register_order(ArvDevice* device) {
  ArvDomElement* root = arv_dom_document_get_document_element(ARV_DOM_DOCUMENT(arv_device_get_genicam(device)));
  arv_dom_element_set_attribute(root, "SchemaMinorVersion", "0");
}

Result<Connection> open_found(Result<FoundCamera> found) {
  ASSIGN_OR_RETURN(const FoundCamera camera, std::move(found));
  return is_ipv4(camera.address) ? open_gige(camera.address) : open_by_id(camera.id);
}

Result<Connection> open_by_serial(const std::string& serial) { return open_found(choose_camera({}, serial)); }

Result<Connection> open(const CameraOptions& options, bool search) {
  if (is_ipv4(options.address)) {
    auto connection = open_gige(options.address);
    if (connection || !search || options.serial.empty() || answers_gvcp(options.address)) return connection;
    auto moved = open_by_serial(options.serial);  // it may have a new address
    return moved ? std::move(moved) : std::move(connection);
  }
  if (options.address.empty() && !options.serial.empty()) return open_by_serial(options.serial);
  return open_found(choose_camera(options.address, {}));
}

// Opens the camera with `open_camera`; a second time with the older schema if the byte order of the registers is wrong.
template <typename Open>
Result<Connection> open_with_byte_order(const Open& open_camera) {
  auto connection = open_camera();
  if (!connection || !has_swapped_registers(connection->device.get())) return connection;
  connection->device.reset();  // releases control first
  connection = open_camera();
  if (connection) use_legacy_register_order(connection->device.get());
  return connection;
}

// From the GenICam description; has_serial() also tries the discovery register, which some cameras format differently.
std::string serial_of(const Connection& connection) {
  Nodes nodes(connection.device.get());
  return read_serial(nodes);
}

bool has_serial(const Connection& connection, const std::string& serial) {
  if (serial_of(connection) == serial) return true;
  if (!connection.is_gige()) return false;
  std::array<char, kSerialBytes + 1> text{};
  GlibError error;
  arv_device_read_memory(connection.device.get(), kSerialRegister, kSerialBytes, text.data(), error.out());
  return !error && serial == text.data();
}

}  // namespace

std::vector<FoundCamera> find_cameras() {
  if (!check_resources()) return {};
  silence_glib();
  {
    const SearchLimit limit;
    arv_update_device_list();
  }
  std::vector<FoundCamera> found;
  const unsigned count = arv_get_n_devices();
  found.reserve(count);
  for (unsigned i = 0; i < count; ++i) {
    found.push_back({.id = safe(arv_get_device_id(i)),
                     .model = safe(arv_get_device_model(i)),
                     .serial = safe(arv_get_device_serial_nbr(i)),
                     .address = safe(arv_get_device_address(i))});
  }
  return found;
}

std::string aravis_version() {
  return fmt::format("{}.{}.{}", arv_get_major_version(), arv_get_minor_version(), arv_get_micro_version());
}

Result<Connection> connect(const CameraOptions& options, bool search) {
  RETURN_IF_ERROR(check_resources());
  survive_division_of_smallest();
  silence_glib();
  auto connection = open_with_byte_order([&] { return open(options, search); });
  if (!connection || options.serial.empty() || has_serial(*connection, options.serial)) return connection;
  const std::string other = serial_of(*connection);
  const std::string name = connection->name;
  connection->device.reset();  // released unchanged
  auto moved = open_with_byte_order([&] { return open_by_serial(options.serial); });
  if (moved) return moved;
  return bad_input(name + " has the serial number '" + other + "', not '" + options.serial +
                   "': it is another camera, and that one answers nowhere");
}

bool is_controlled(const Connection& connection) {
  if (!connection.is_gige()) return true;
  std::uint32_t privilege = 0;
  GlibError error;
  arv_device_read_register(connection.device.get(), kPrivilegeRegister, &privilege, error.out());
  return !error && (privilege & kControlled) != 0;
}

}  // namespace bolo::genicam

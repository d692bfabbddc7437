#include "drivers/genicam/connection.hpp"

#include <cstdint>
#include <utility>
#include <vector>

#include "drivers/genicam/discovery.hpp"

namespace bolo::genicam {
namespace {

constexpr std::uint64_t kPrivilegeRegister = 0x0A00;  // GigE Vision: control channel privilege
constexpr std::uint32_t kControlled = 0x3;            // exclusive access, or control access

std::string list_of(const std::vector<FoundCamera>& cameras) {
  std::string text;
  for (const FoundCamera& f : cameras) text += (text.empty() ? "" : ", ") + f.id + " at " + f.address;
  return text;
}

// The camera to open when the options do not name an IP address.
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

// Opens the device at the connection's address: as its controller, unless another program is.
Status take_device(Connection& connection) {
  const Ref<GInetAddress> local(g_inet_address_new_from_string(connection.route.local_address.c_str()));
  const Ref<GInetAddress> remote(g_inet_address_new_from_string(connection.address.c_str()));
  GlibError error;
  connection.device.reset();
  connection.device.reset(arv_gv_device_new(local.get(), remote.get(), error.out()));
  if (!error && connection.device != nullptr) return {};
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
  auto route = route_to(ipv4);
  if (!route) return tl::unexpected<Error>(std::move(route.error()));
  connection.route = std::move(*route);
  if (!answers_gvcp(ipv4)) {
    return bad_input("no camera answers at " + ipv4 + " through " + connection.route.interface + " (" +
                     connection.route.local_address +
                     "): check its power and cable, its address, and that no firewall drops UDP port 3956");
  }
  if (Status opened = take_device(connection); !opened) return tl::unexpected<Error>(std::move(opened.error()));
  if (!is_controller(connection) && free_from_dead_program(ipv4, connection.route.local_address)) {
    if (Status opened = take_device(connection); !opened) return tl::unexpected<Error>(std::move(opened.error()));
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
  connection.device.reset(arv_open_device(id.c_str(), error.out()));
  if (error || connection.device == nullptr) {
    connection.device.reset();
    return bad_input("camera " + id + " cannot be opened (" + error.message() +
                     "): check that no other program uses it and that you may access the device");
  }
  return connection;
}

// Some FLIR cameras describe their registers in the byte order of an older schema: 640 columns then read as
// 2147614720 (640 with its bytes reversed).
bool registers_look_swapped(ArvDevice* device) {
  GlibError error;
  const auto width = arv_device_get_integer_feature_value(device, "Width", error.out());
  if (error || width < (1 << 16)) return false;
  return __builtin_bswap32(static_cast<std::uint32_t>(width)) < (1U << 16);
}

// Makes Aravis read the registers as that older schema has them. Must come before any node is read.
void use_legacy_register_order(ArvDevice* device) {
  ArvDomElement* root = arv_dom_document_get_document_element(ARV_DOM_DOCUMENT(arv_device_get_genicam(device)));
  arv_dom_element_set_attribute(root, "SchemaMinorVersion", "0");
}

Result<Connection> open(const CameraOptions& options) {
  if (is_ipv4(options.address)) {
    auto connection = open_gige(options.address);
    if (connection || options.serial.empty() || answers_gvcp(options.address)) return connection;
    auto moved = choose_camera({}, options.serial);  // it may have been given another address
    return moved && is_ipv4(moved->address) ? open_gige(moved->address) : std::move(connection);
  }
  auto camera = choose_camera(options.address, options.serial);
  if (!camera) return tl::unexpected<Error>(std::move(camera.error()));
  return is_ipv4(camera->address) ? open_gige(camera->address) : open_by_id(camera->id);
}

}  // namespace

Result<Connection> connect(const CameraOptions& options) {
  auto connection = open(options);
  if (!connection || !registers_look_swapped(connection->device.get())) return connection;
  connection->device.reset();  // lets go of control first
  connection = open(options);
  if (connection) use_legacy_register_order(connection->device.get());
  return connection;
}

bool is_controlled(const Connection& connection) {
  if (!connection.is_gige()) return true;
  std::uint32_t privilege = 0;
  GlibError error;
  arv_device_read_register(connection.device.get(), kPrivilegeRegister, &privilege, error.out());
  return !error && (privilege & kControlled) != 0;
}

}  // namespace bolo::genicam

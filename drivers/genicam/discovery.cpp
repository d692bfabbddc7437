#include "drivers/genicam/discovery.hpp"

#include <fmt/format.h>

#include "drivers/genicam/gobject.hpp"

namespace bolo::genicam {
namespace {

std::string safe(const char* text) { return text != nullptr ? text : ""; }

}  // namespace

std::vector<FoundCamera> find_cameras() {
  arv_update_device_list();
  std::vector<FoundCamera> found;
  const unsigned count = arv_get_n_devices();
  found.reserve(count);
  for (unsigned i = 0; i < count; ++i) {
    found.push_back({safe(arv_get_device_id(i)), safe(arv_get_device_address(i)), safe(arv_get_device_model(i)),
                     safe(arv_get_device_serial_nbr(i))});
  }
  return found;
}

std::string aravis_version() {
  return fmt::format("{}.{}.{}", arv_get_major_version(), arv_get_minor_version(), arv_get_micro_version());
}

}  // namespace bolo::genicam

#include "drivers/genicam/nodes.hpp"

#include <algorithm>

#include <fmt/format.h>

namespace bolo::genicam {

bool Nodes::has(const char* name) {
  if (!ok()) return false;
  ArvGcNode* node = arv_device_get_feature(device_, name);
  if (!ARV_IS_GC_FEATURE_NODE(node)) return false;
  GlibError error;
  const bool available = arv_gc_feature_node_is_available(ARV_GC_FEATURE_NODE(node), error.out()) != FALSE;
  check(error, name);
  return available && ok();
}

template <typename Value>
Value Nodes::read(Value (*get)(ArvDevice*, const char*, GError**), const char* name) {
  if (!ok()) return {};
  GlibError error;
  const Value value = get(device_, name, error.out());
  check(error, name);
  return ok() ? value : Value{};
}

template <typename Value>
void Nodes::write(void (*set)(ArvDevice*, const char*, Value, GError**), const char* name, Value value,
                  const std::string& asked) {
  if (!ok()) return;
  GlibError error;
  set(device_, name, value, error.out());
  check(error, name, asked);
}

std::int64_t Nodes::integer(const char* name) { return read(arv_device_get_integer_feature_value, name); }

double Nodes::real(const char* name) { return read(arv_device_get_float_feature_value, name); }

bool Nodes::boolean(const char* name) { return read(arv_device_get_boolean_feature_value, name) == TRUE; }

std::string Nodes::text(const char* name) {
  const char* const value = read(arv_device_get_string_feature_value, name);
  return value != nullptr ? value : "";
}

double Nodes::number(const char* name) {
  if (!ok()) return 0.0;
  const bool is_float = ARV_IS_GC_FLOAT(arv_device_get_feature(device_, name)) != FALSE;
  return is_float ? real(name) : static_cast<double>(integer(name));
}

std::vector<std::string> Nodes::entries(const char* name) {
  if (!ok() || !is_enumeration(name)) return {};
  GlibError error;
  guint count = 0;
  const Owned<const char*> values(
      arv_device_dup_available_enumeration_feature_values_as_strings(device_, name, &count, error.out()));
  check(error, name);
  if (!ok() || values == nullptr) return {};
  return {values.get(), values.get() + count};
}

void Nodes::set_integer(const char* name, std::int64_t value) {
  write<gint64>(arv_device_set_integer_feature_value, name, value, std::to_string(value));
}

void Nodes::set_real(const char* name, double value) {
  write(arv_device_set_float_feature_value, name, value, fmt::format("{:g}", value));
}

void Nodes::set_boolean(const char* name, bool value) {
  write(arv_device_set_boolean_feature_value, name, value ? TRUE : FALSE, value ? "true" : "false");
}

void Nodes::choose(const char* name, const char* entry, std::int64_t value) {
  const std::vector<std::string> offered = entries(name);
  if (std::find(offered.begin(), offered.end(), entry) != offered.end()) {
    write(arv_device_set_string_feature_value, name, entry, entry);
  } else {
    write<gint64>(arv_device_set_integer_feature_value, name, value, entry);
  }
}

void Nodes::execute(const char* command) {
  if (!ok()) return;
  GlibError error;
  arv_device_execute_command(device_, command, error.out());
  check(error, command, "execute");
}

bool Nodes::is_enumeration(const char* name) const {
  return ARV_IS_GC_ENUMERATION(arv_device_get_feature(device_, name)) != FALSE;
}

void Nodes::check(const GlibError& error, const char* name, const std::string& asked) {
  if (!error) return;
  if (error.unanswered()) {
    status_ = failed(std::string("the camera stopped answering at ") + name + " (" + error.message() + ")");
  } else if (asked.empty()) {
    status_ = bad_input(std::string("the camera refused to read ") + name + " (" + error.message() + ")");
  } else {
    status_ = bad_input(std::string("the camera refused ") + name + " = " + asked + " (" + error.message() + ")");
  }
}

std::string read_serial(Nodes& nodes) {
  for (const char* name : {"DeviceSerialNumber", "DeviceID"}) {
    if (nodes.has(name)) return nodes.text(name);
  }
  return {};
}

}  // namespace bolo::genicam

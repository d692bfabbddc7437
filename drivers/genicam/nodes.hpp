// Camera settings by name. Keeps the first failure, so that a sequence of reads and writes is checked once at its end.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "drivers/genicam/gobject.hpp"
#include "src/core/result.hpp"

namespace bolo::genicam {

// After a failure, further calls do nothing and return zero or empty. Thread: setup.
class Nodes {
 public:
  explicit Nodes(ArvDevice* device) : device_(device) {}

  // True when the camera has this node and it is available now.
  bool has(const char* name);

  std::int64_t integer(const char* name);
  double real(const char* name);
  double number(const char* name);                     // an integer or float node
  std::string text(const char* name);                  // strings, and the entry of an enumeration
  std::vector<std::string> entries(const char* name);  // currently available entries of an enumeration

  bool boolean(const char* name);

  void set_integer(const char* name, std::int64_t value);
  void set_real(const char* name, double value);
  void set_boolean(const char* name, bool value);
  // Sets an enumeration by its entry; by value when the entries have other names or the node is an integer.
  void choose(const char* name, const char* entry, std::int64_t value);
  void execute(const char* command);

  // kBadInput: the camera refused a setting. kFailed: it did not answer.
  const Status& status() const { return status_; }
  bool ok() const { return status_.has_value(); }

 private:
  template <typename Value>
  Value read(Value (*get)(ArvDevice*, const char*, GError**), const char* name);
  template <typename Value>
  void write(void (*set)(ArvDevice*, const char*, Value, GError**), const char* name, Value value,
             const std::string& asked);
  bool is_enumeration(const char* name) const;
  // Records the error of a call on `name`; `asked`: the value being set, or empty.
  void check(const GlibError& error, const char* name, const std::string& asked = {});

  ArvDevice* device_;
  Status status_;
};

// From the camera's description; empty when it has none. Thread: setup.
std::string read_serial(Nodes& nodes);

}  // namespace bolo::genicam

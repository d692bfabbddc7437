// The camera's settings by name: reads and writes that remember the first failure, so that a sequence of them reads as
// one, and is checked once.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "drivers/genicam/gobject.hpp"
#include "src/core/result.hpp"

namespace bolo::genicam {

// After a failure every further call does nothing and returns zero or empty. Thread: setup.
class Nodes {
 public:
  explicit Nodes(ArvDevice* device) : device_(device) {}

  // The camera has this node and offers it now.
  bool has(const char* name);

  std::int64_t integer(const char* name);
  double real(const char* name);
  double number(const char* name);                     // an integer or a float, whichever the camera has
  std::string text(const char* name);                  // strings, and the entry of an enumeration
  std::vector<std::string> entries(const char* name);  // that an enumeration offers now

  bool boolean(const char* name);

  void set_integer(const char* name, std::int64_t value);
  void set_real(const char* name, double value);
  void set_boolean(const char* name, bool value);
  // Sets an enumeration by its entry; by value when the camera names its entries otherwise or has a plain integer.
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
  // Takes the error of a call on `name`; `asked` is the value that was being set, or empty.
  void check(const GlibError& error, const char* name, const std::string& asked = {});

  ArvDevice* device_;
  Status status_;
};

// From the camera's description; empty when it has none. Thread: setup.
std::string read_serial(Nodes& nodes);

}  // namespace bolo::genicam

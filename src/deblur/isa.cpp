#include "src/deblur/isa.hpp"

#include <algorithm>
#include <string>

namespace bolo::deblur {

Status check_isa(std::string_view name) {
  const std::vector<std::string_view> names = available_isas();
  if (name == "auto" || std::find(names.begin(), names.end(), name) != names.end()) return {};
  std::string known = "auto";
  for (const std::string_view each : names) known.append(", ").append(each);
  return bad_input("instruction set \"" + std::string(name) + "\" is not available here; use one of " + known);
}

Status choose_isa(std::string_view name) {
  if (Status good = check_isa(name); !good) return good;
  force_isa(name == "auto" ? "" : name);
  return {};
}

}  // namespace bolo::deblur

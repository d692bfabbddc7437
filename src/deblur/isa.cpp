#include "bolo/deblur/isa.hpp"

#include <string>

namespace bolo::deblur {

Status choose_isa(std::string_view name) {
  if (force_isa(name == "auto" ? "" : name)) return {};
  std::string known = "auto";
  for (const std::string_view each : available_isas()) known.append(", ").append(each);
  return bad_input("instruction set \"" + std::string(name) + "\" is not available here; use one of " + known);
}

}  // namespace bolo::deblur

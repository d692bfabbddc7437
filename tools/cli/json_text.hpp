// JSON for other programs.
#pragma once

#include <string>

namespace bolo::tools {

// Whatever bytes names of files and texts of devices hold: what is no UTF-8 becomes U+FFFD, where the library by itself
// would end the program. `indent`: spaces a level; -1: all on one line. Thread: any.
template <typename Json>
std::string json_text(const Json& json, int indent = -1) {
  return json.dump(indent, ' ', false, Json::error_handler_t::replace);
}

}  // namespace bolo::tools

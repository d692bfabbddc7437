// JSON for other programs.
#pragma once

#include <string>

namespace bolo::tools {

// On one line, whatever bytes names of files and texts of cameras hold: what is no UTF-8 becomes U+FFFD, where the
// library by itself would end the program. Thread: any.
template <typename Json>
std::string json_text(const Json& json) {
  return json.dump(-1, ' ', false, Json::error_handler_t::replace);
}

}  // namespace bolo::tools

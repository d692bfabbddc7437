// How a capture is spelled in MCAP, for its writer and its reader. docs/formats.md has the table.
#pragma once

#include <algorithm>
#include <array>
#include <cstddef>
#include <string>
#include <string_view>

#include "src/core/printable.hpp"

namespace bolo::tools::mcap_names {

// A metadata record of this name for each topic of images: `topic`, and what a capture's root says.
inline constexpr const char* kCapture = "bolo-capture";
inline constexpr std::string_view kText = "text.";      // attributes beyond the format's own
inline constexpr std::string_view kNumber = "number.";  // likewise

// The attribute in a key that begins with `prefix`; empty: none that a capture could have.
inline std::string attribute_in(std::string_view key, std::string_view prefix) {
  constexpr std::array<std::string_view, 9> kOwn{"format",         "version",      "unit",          "scale",   "offset",
                                                 "frame_period_s", "camera_model", "camera_serial", "row_step"};
  constexpr std::size_t kMostBytes = 255;
  if (!key.starts_with(prefix)) return {};
  key.remove_prefix(prefix.size());
  const bool good = key.size() <= kMostBytes && printable(key) == key && std::ranges::find(kOwn, key) == kOwn.end();
  return good ? std::string(key) : std::string();
}

}  // namespace bolo::tools::mcap_names

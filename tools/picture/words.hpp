// Numbers within captions.
#pragma once

#include <cstdio>
#include <string>

namespace bolo::tools {

// As printf does it, at most 255 characters. `format` is a literal.
template <typename... Values>
std::string words(const char* format, Values... values) {
  char text[256];
  std::snprintf(text, sizeof text, format, values...);  // NOLINT: the formats are literals
  return text;
}

}  // namespace bolo::tools

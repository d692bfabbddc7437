// Durations in words, for the log and for people.
#pragma once

#include <cstdint>
#include <cstdio>
#include <string>

namespace bolo {

// "1.5 s". Thread: any.
inline std::string seconds_text(std::int64_t ns, int decimals = 1) {
  char text[40];
  std::snprintf(text, sizeof text, "%.*f s", decimals, static_cast<double>(ns) * 1e-9);
  return text;
}

}  // namespace bolo

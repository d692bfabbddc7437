// Text from devices, files and other programs, made fit to be shown.
#pragma once

#include <cstddef>
#include <string>
#include <string_view>

namespace bolo {

// Bytes of the character that begins `text`: 0 where it is no whole UTF-8 character, or one that moves a cursor instead
// of showing something (C0, DEL, C1, and U+2028 to U+202E and U+2066 to U+2069, which break lines or turn them round).
// Thread: any.
inline std::size_t printable_character(std::string_view text) {
  const auto byte = [&](std::size_t i) { return i < text.size() ? static_cast<unsigned char>(text[i]) : 0U; };
  const unsigned first = byte(0);
  if (first < 0x80U) return first >= 0x20U && first != 0x7fU ? 1 : 0;
  const std::size_t length = first >= 0xf0U ? 4 : first >= 0xe0U ? 3 : 2;
  if (first < 0xc2U || first > 0xf4U) return 0;
  unsigned code = first & (0x7fU >> length);
  for (std::size_t i = 1; i < length; ++i) {
    if ((byte(i) & 0xc0U) != 0x80U) return 0;
    code = code << 6U | (byte(i) & 0x3fU);
  }
  const bool shortest = code >= (length == 2 ? 0x80U : length == 3 ? 0x800U : 0x10000U);
  const bool surrogate = code >= 0xd800U && code <= 0xdfffU;
  const bool moves = code < 0xa0U || (code >= 0x2028U && code <= 0x202eU) || (code >= 0x2066U && code <= 0x2069U);
  return shortest && !surrogate && code <= 0x10ffffU && !moves ? length : 0;
}

// The text on one line, without anything that a terminal would take for an order: what is not printable becomes '?'.
// Names of files, shared memory and devices, and texts that cameras and other programs tell, are anybody's. Thread:
// any.
inline std::string printable(std::string_view text) {
  std::string shown;
  shown.reserve(text.size());
  while (!text.empty()) {
    const std::size_t bytes = printable_character(text);
    if (bytes == 0) {
      shown += '?';
    } else {
      shown += text.substr(0, bytes);
    }
    text.remove_prefix(bytes == 0 ? 1 : bytes);
  }
  return shown;
}

}  // namespace bolo

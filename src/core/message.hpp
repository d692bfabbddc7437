// Messages that quote values of any length: one printable line of a bounded length.
#pragma once

#include <cstddef>
#include <string>
#include <string_view>

#include "src/core/text.hpp"

namespace bolo {

// The text, or the beginning of a longer one, for a message that quotes it. Thread: any.
inline std::string excerpt(std::string_view text, std::size_t most = 80) {
  if (text.size() <= most) return std::string(text);
  while (most > 0 && (static_cast<unsigned char>(text[most]) & 0xc0U) == 0x80U) --most;  // between characters
  return std::string(text.substr(0, most)) + "...";
}

// An error or a message for the log. A long one, because of what it quotes, loses its middle: where something is wrong
// is at its beginning, what to do at its end. Thread: any.
inline std::string message_line(std::string_view message) {
  constexpr std::size_t kBegin = 1500;
  constexpr std::size_t kEnd = 500;
  if (message.size() <= kBegin + kEnd) return printable(message);
  return printable(excerpt(message, kBegin)) + " " + printable(message.substr(message.size() - kEnd));
}

}  // namespace bolo

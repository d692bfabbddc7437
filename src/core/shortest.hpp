// Numbers in messages, scripts and captures' attributes.
#pragma once

#include <array>
#include <charconv>
#include <string>
#include <system_error>

namespace bolo {

// The fewest digits that read back as the same number. Thread: any.
inline std::string shortest(double value) {
  std::array<char, 32> text{};
  const auto [end, error] = std::to_chars(text.data(), text.data() + text.size(), value);
  return error == std::errc() ? std::string(text.data(), end) : std::string("?");
}

}  // namespace bolo

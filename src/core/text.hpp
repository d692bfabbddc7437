// Text: untrusted text made printable, numbers and durations, suggestions for misspelt words.
#pragma once

#include <algorithm>
#include <array>
#include <charconv>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <cstdio>
#include <numeric>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <system_error>
#include <vector>

namespace bolo {

// Bytes of the first character of `text`; 0 if it is no complete UTF-8 character, or a control character: C0, DEL, C1,
// and U+2028 to U+202E and U+2066 to U+2069, which break lines or change the writing direction. Thread: any.
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

// The text on one line, unprintable characters replaced by '?', so that it cannot control a terminal. Names of files,
// shared memory and devices, and texts of cameras and other programs, are untrusted. Thread: any.
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

// The fewest digits that read back as the same number. Thread: any.
inline std::string shortest(double value) {
  std::array<char, 32> text{};
  const auto [end, error] = std::to_chars(text.data(), text.data() + text.size(), value);
  return error == std::errc() ? std::string(text.data(), end) : std::string("?");
}

// "1.5 s". Thread: any.
inline std::string seconds_text(std::int64_t ns, int decimals = 1) {
  char text[40];
  std::snprintf(text, sizeof text, "%.*f s", decimals, static_cast<double>(ns) * 1e-9);
  return text;
}

// The text without leading and trailing blanks. Thread: any.
inline std::string_view trimmed(std::string_view text) {
  const std::size_t first = text.find_first_not_of(" \t\r");
  if (first == std::string_view::npos) return {};
  return text.substr(first, text.find_last_not_of(" \t\r") - first + 1);
}

// The whole text as a finite number. Thread: any.
inline std::optional<double> number_of(std::string_view text) {
  double value = 0.0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
  if (error != std::errc() || end != text.data() + text.size() || !std::isfinite(value)) return std::nullopt;
  return value;
}

// The whole text as an integer. Thread: any.
template <typename Number>
std::optional<Number> whole_number(std::string_view text, int base = 10) {
  Number value{};
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value, base);
  return error == std::errc() && end == text.data() + text.size() ? std::optional(value) : std::nullopt;
}

// Levenshtein distance, row by row. Thread: any.
inline std::size_t edit_distance(std::string_view word, std::string_view other) {
  std::vector<std::size_t> row(other.size() + 1);
  std::iota(row.begin(), row.end(), std::size_t{0});
  for (const char c : word) {
    std::size_t diagonal = row[0]++;
    for (std::size_t j = 1; j < row.size(); ++j) {
      const std::size_t changed = diagonal + (other[j - 1] == c ? 0 : 1);
      diagonal = row[j];
      row[j] = std::min({changed, row[j] + 1, row[j - 1] + 1});
    }
  }
  return row.back();
}

// The word with the smallest edit distance; the first of equals. Thread: any.
inline std::string nearest(std::string_view word, std::span<const std::string_view> words) {
  const auto distance = [word](std::string_view candidate) { return edit_distance(word, candidate); };
  const auto best = std::ranges::min_element(words, {}, distance);
  return best != words.end() ? std::string(*best) : std::string();
}

// "there is no WHAT 'name'; did you mean '...'?" Thread: any.
inline std::string did_you_mean(std::string_view what, std::string_view name, std::span<const std::string_view> names) {
  return "there is no " + std::string(what) + " '" + std::string(name) + "'; did you mean '" + nearest(name, names) +
         "'?";
}

}  // namespace bolo

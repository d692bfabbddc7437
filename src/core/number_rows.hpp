// Hand-written files of numbers: one row per line, separated by commas.
#pragma once

#include <array>
#include <filesystem>
#include <optional>
#include <sstream>
#include <string>
#include <string_view>
#include <utility>

#include "src/core/input_file.hpp"
#include "src/core/result.hpp"
#include "src/core/text.hpp"

namespace bolo {

// Exactly N finite numbers; nothing for any other line. Thread: any.
template <std::size_t N>
std::optional<std::array<double, N>> numbers_of(std::string_view line) {
  std::array<double, N> values{};
  for (std::size_t i = 0; i < N; ++i) {
    const std::size_t comma = line.find(',');
    const std::optional<double> value = number_of(trimmed(line.substr(0, comma)));
    if (!value || (comma == std::string_view::npos) != (i + 1 == N)) return std::nullopt;
    values[i] = *value;
    line.remove_prefix(comma == std::string_view::npos ? line.size() : comma + 1);
  }
  return values;
}

// Calls take(line, first) for each line except empty ones and those that begin with #; the `first` may be a header.
// Errors of take are prefixed with file and line. Thread: any.
template <typename Take>
Status read_rows(const std::filesystem::path& file, const Take& take) {
  ASSIGN_OR_RETURN(std::string whole, read_input(file));
  if (whole.starts_with("\xef\xbb\xbf")) whole.erase(0, 3);  // byte order mark that spreadsheets write before UTF-8
  std::istringstream in(std::move(whole));
  std::string text;
  bool first = true;
  for (int number = 1; std::getline(in, text); ++number) {
    const std::string_view line = trimmed(text);
    if (line.empty() || line.front() == '#') continue;
    const Status taken = take(line, std::exchange(first, false));
    if (!taken) return at(file.string() + ":" + std::to_string(number), taken.error());
  }
  return {};
}

}  // namespace bolo

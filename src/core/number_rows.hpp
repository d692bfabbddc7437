// Hand-written files of numbers: one row per line, separated by commas.
#pragma once

#include <algorithm>
#include <array>
#include <filesystem>
#include <optional>
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
  ASSIGN_OR_RETURN(const std::string whole, read_input(file));
  std::string_view rest = whole;
  if (rest.starts_with("\xef\xbb\xbf")) rest.remove_prefix(3);  // byte order mark that spreadsheets write before UTF-8
  bool first = true;
  for (int number = 1; !rest.empty(); ++number) {
    const std::size_t end = std::min(rest.find('\n'), rest.size());
    const std::string_view line = trimmed(rest.substr(0, end));
    rest.remove_prefix(std::min(end + 1, rest.size()));
    if (line.empty() || line.front() == '#') continue;
    const Status taken = take(line, std::exchange(first, false));
    if (!taken) return at(file.string() + ":" + std::to_string(number), taken.error());
  }
  return {};
}

}  // namespace bolo

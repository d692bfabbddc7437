// The word a person may have meant.
#pragma once

#include <algorithm>
#include <cstddef>
#include <numeric>
#include <span>
#include <string>
#include <string_view>
#include <vector>

namespace bolo {

// Letters to change, to add or to leave out to make one of the other: Levenshtein's distance, row by row. Thread: any.
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

// The one of `words` with the fewest letters to change; the first of equals. Thread: any.
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

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

// The one of `words` with the fewest letters to change; the first of equals. Thread: any.
inline std::string nearest(std::string_view word, std::span<const std::string_view> words) {
  std::string best;
  std::size_t least = std::string::npos;
  for (const std::string_view candidate : words) {
    std::vector<std::size_t> row(candidate.size() + 1);  // Levenshtein's distance, row by row
    std::iota(row.begin(), row.end(), std::size_t{0});
    for (const char c : word) {
      std::size_t diagonal = row[0]++;
      for (std::size_t j = 1; j < row.size(); ++j) {
        const std::size_t changed = diagonal + (candidate[j - 1] == c ? 0 : 1);
        diagonal = row[j];
        row[j] = std::min({changed, row[j] + 1, row[j - 1] + 1});
      }
    }
    if (row.back() >= least) continue;
    least = row.back();
    best = candidate;
  }
  return best;
}

// "there is no WHAT 'name'; did you mean '...'?" Thread: any.
inline std::string did_you_mean(std::string_view what, std::string_view name, std::span<const std::string_view> names) {
  return "there is no " + std::string(what) + " '" + std::string(name) + "'; did you mean '" + nearest(name, names) +
         "'?";
}

}  // namespace bolo

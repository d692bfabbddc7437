// Order statistics of what was measured.
#pragma once

#include <algorithm>
#include <cstddef>
#include <vector>

namespace bolo::tools {

// The value that `share` (0 to 1) of the others do not exceed; 0 of none. Thread: any.
inline double percentile(std::vector<double> values, double share) {
  if (values.empty()) return 0.0;
  const auto at = static_cast<std::ptrdiff_t>(share * static_cast<double>(values.size() - 1));
  std::nth_element(values.begin(), values.begin() + at, values.end());
  return values[static_cast<std::size_t>(at)];
}

}  // namespace bolo::tools

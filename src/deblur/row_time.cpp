#include "src/deblur/row_time.hpp"

#include <algorithm>
#include <cmath>

namespace bolo::deblur {

Published published_bins(const Grid& grid, int slots, int target, double delay) noexcept {
  const int last = (slots - 1) * grid.parts - 1;
  const double q = grid.parts * (target - delay) - 0.5;
  const double whole = std::floor(q);
  const auto after = static_cast<float>(q - whole);
  const auto bin = [&](double step) {
    return static_cast<int>(std::clamp(step, 0.0, static_cast<double>(last))) / grid.frames_per_bin;
  };
  return {bin(whole), bin(whole + 1.0), 1.0F - after, after};
}

}  // namespace bolo::deblur

#include "src/deblur/tuning.hpp"

#include <algorithm>
#include <cmath>

namespace bolo::deblur {

Tuning tune(const Grid& grid, double kelvin_per_value) {
  const double p = -std::expm1(-grid.ratio);
  (void)kelvin_per_value;
  return {std::clamp(p * p, 0.002, 0.3), 1.8, 12};
}

}  // namespace bolo::deblur

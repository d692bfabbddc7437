// The first-order inverse filter on the samples next to the target.
#pragma once

#include "src/deblur/grid.hpp"

namespace bolo::deblur {

// Over a gap of g frames without samples the input is taken as constant: x = (y_1 - a^g y_0) / (1 - a^g). Written with
// differences, so that no precision is lost at 300 K:
//   estimate = y_t + back (y_t - y_before) + ahead (y_after - y_t).
struct InversePlan {
  int before = 0;  // slots; the target's own where there is none
  int target = 0;
  int after = 0;
  float back = 0.0F;
  float ahead = 0.0F;
};

// With look-ahead the estimate is the mean of the inputs before and after the target's time, as far as there are
// samples for them. Thread: any.
InversePlan make_inverse_plan(const Grid& grid, const Pattern& pattern) noexcept;

}  // namespace bolo::deblur

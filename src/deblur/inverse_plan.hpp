// The first-order inverse filter on the samples next to the published time.
#pragma once

#include <array>

#include "src/deblur/grid.hpp"

namespace bolo::deblur {

// Over a gap of g frames without samples the input is taken as constant: x = (y_1 - a^g y_0) / (1 - a^g). Written with
// differences from the target's sample, so that no precision is lost at 300 K:
//   estimate = y_t + sum over taps of weight (y_slot - y_t).
struct InversePlan {
  struct Tap {
    int slot = 0;
    float weight = 0.0F;
  };
  int target = 0;
  int taps = 0;
  std::array<Tap, 4> tap{};
};

// The published value is linear between centres of frame intervals (grid.hpp), each at the input of the gap that
// it lies in; intervals before the first sample or after the last take the nearest gap's. `delay`: of the row, in frame
// periods. Thread: any.
InversePlan make_inverse_plan(const Grid& grid, const Pattern& pattern, double delay = 0.0) noexcept;

}  // namespace bolo::deblur

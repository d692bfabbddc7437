// Which bins are published when a row is sampled later than its frame's time.
//
// Every row has a window of the same shape on its own sample times: sample s of a row with delay d lies at s T + d. The
// frame's time is that of its target's row 0, so it lies d before the row's own target sample. The published value is
// the estimated input there, linear between the centres of the intervals over which it is constant (bins; frame
// intervals where a bin is longer), and limited to the first and the last of them:
//   position in intervals of width T / parts:  q = parts (target - d / T) - 1/2,  before = floor(q), after = before +
//   1, weight_after = q - before.
// Without delay that is the mean of the bins before and after the target's time, and at the window's end the last bin.
#pragma once

#include "src/deblur/grid.hpp"

namespace bolo::deblur {

// delay: in frame periods; negative for rows that are sampled before the frame's time. Thread: any.
Published published_bins(const Grid& grid, int slots, int target, double delay) noexcept;

}  // namespace bolo::deblur

// Which of a block's two estimates is likely to be the better one: the one along the motion, or the per-pixel one.
#pragma once

#include "src/motion/innovation.hpp"

namespace bolo::motion {

inline constexpr float kMargin = 1.25F;  // of what noise alone makes of a mean square

// Evidence about a block's two estimates; errors and energies in units of the noise's variance.
struct Evidence {
  float mine;       // mean square error that the estimate along the motion should have
  float other;      // and the per-pixel one, as it says itself
  float per_pixel;  // what any per-pixel one leaves besides noise if the scene moves as is said, as far as that fits
                    // the past
  float left;       // energy of what the estimate leaves of the innovation
  float change;     // of innovation less frame
  float speed;      // px a frame
  bool seen;        // before this frame
};

// The logarithm of the odds that the per-pixel estimate is the better one. `ahead`: with look-ahead. Thread: any.
float odds(const Inertia& inertia, bool ahead, const Evidence& e) noexcept;

}  // namespace bolo::motion

// Odds that the per-pixel estimate of a block is better than the one along the motion.
#pragma once

#include "src/motion/innovation.hpp"

namespace bolo::motion {

inline constexpr float kMargin = 1.25F;  // of a mean square due to noise alone

// Evidence about a block's two estimates; errors and energies in units of the noise's variance.
struct Evidence {
  float mine;       // mean square error that the estimate along the motion should have
  float other;      // and the per-pixel one, by its own estimate
  float per_pixel;  // error beyond noise of any per-pixel estimate if the motion is right, as far as that fits
                    // the past
  float left;       // energy of the innovation's residual after the estimate
  float change;     // of innovation less frame
  float own;        // the same without the blocks around it
  float speed;      // px a frame
  bool seen;        // before this frame
  int bridged = 0;  // lost frames that the motion was found across
};

// The logarithm of the odds that the per-pixel estimate is the better one. `ahead`: with look-ahead. Thread: any.
float odds(const Inertia& inertia, bool ahead, const Evidence& e) noexcept;

}  // namespace bolo::motion

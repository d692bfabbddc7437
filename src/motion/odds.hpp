// Odds that the per-pixel estimate of a block is better than the one along the motion.
#pragma once

#include "src/motion/innovation.hpp"

namespace bolo::motion {

inline constexpr float kMargin = 1.25F;  // times the mean square of noise alone

// Evidence about a block's two estimates; errors and energies in units of the noise's variance.
struct Evidence {
  float mine;       // expected mean square error of the estimate along the motion
  float other;      // of the per-pixel one, by its own estimate
  float per_pixel;  // beyond noise, of any per-pixel estimate if the motion is right; less if it fits the past badly
  float left;       // energy of the innovation's residual after the estimate
  float change;     // energy of innovation less frame
  float own;        // the same, of this block alone
  float speed;      // px a frame
  float apart;      // mean square difference of both estimates in this block
  float contrast;   // half the mean square difference of the past's mean over 2 px across the motion
  bool seen;        // visible before this frame
  int bridged = 0;  // lost frames across which the motion was found
};

// Log odds that the per-pixel estimate is the better one. `ahead`: with look-ahead. Thread: any.
float odds(const Inertia& inertia, bool ahead, const Evidence& e) noexcept;

}  // namespace bolo::motion

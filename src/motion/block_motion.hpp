// The published motion: a velocity and its confidence by block.
#pragma once

#include <array>

#include "src/core/scene_motion.hpp"
#include "src/motion/block_field.hpp"
#include "src/motion/global_motion.hpp"
#include "src/motion/innovation.hpp"
#include "src/motion/kernels.hpp"

namespace bolo::motion {

struct BlockMotionInputs {
  Affine trail;                       // from the frame before to this one (Path::trail)
  const VectorField& deviation;       // of the blocks from the whole picture's displacement
  const ScalarField& misfit;          // LocalMotion::misfit()
  const BlockField<MatchSums>& sums;  // LocalMotion::sums()
  double noise = 0.0;                 // standard deviation of a frame, in the values' unit
};

class BlockMotions {
 public:
  // Thread: setup.
  explicit BlockMotions(Geometry geometry);

  // Confidence is 1 / (1 + (s / 0.25 px)^2), s the velocity's standard error, px a frame, from 24 x 24 pixels around
  // the block, in the direction of their weakest gradients: 0 without contrast, small on a single edge. It vanishes
  // where the two innovations do not match (misfit above 1). No allocation. Thread: pipeline.
  void find(const Inertia& inertia, const BlockMotionInputs& in) noexcept;
  // Result of the last find(). Thread: pipeline.
  const SceneMotion& found() const noexcept { return found_; }

 private:
  Geometry geometry_;
  VectorField trail_;
  std::array<ScalarField, 4> raw_;   // gradients xx, xy, yy and residuals, squared
  std::array<ScalarField, 4> mean_;  // over 24 x 24 pixels
  SceneMotion found_;
};

}  // namespace bolo::motion

// The published motion: a velocity and its confidence by block.
#pragma once

#include <array>

#include "src/core/crew.hpp"
#include "src/core/scene_motion.hpp"
#include "src/motion/block_field.hpp"
#include "src/motion/global_motion.hpp"
#include "src/motion/innovation.hpp"

namespace bolo::motion {

struct BlockMotionInputs {
  Affine trail;                  // from the frame before to this one (Path::trail)
  const VectorField& global;     // displacements from `before` to `now` of the whole picture
  const VectorField& deviation;  // of the blocks from it
  const ScalarField& misfit;     // LocalMotion::misfit()
  const PaddedPlane& before;     // smoothed innovations that were matched
  const PaddedPlane& now;
  double noise = 0.0;  // standard deviation of a frame, in the values' unit
};

class BlockMotions {
 public:
  // Thread: setup.
  explicit BlockMotions(Geometry geometry);

  // Confidence is 1 / (1 + (s / 0.25 px)^2), s the standard error, px a frame, of the velocity from 24 x 24 pixels
  // around the block, in the direction of their weakest gradients: 0 without contrast, small on a single edge. It
  // vanishes where the two innovations do not match (misfit above 1). No allocation. Thread: pipeline.
  void find(const Kernels& kernels, const Inertia& inertia, const BlockMotionInputs& in, Crew& crew) noexcept;
  // Of the last find(). Thread: pipeline.
  const SceneMotion& found() const noexcept { return found_; }

 private:
  Geometry geometry_;
  VectorField trail_;
  VectorField matched_;
  BlockField<MatchSums> sums_;
  std::array<ScalarField, 4> raw_;   // gradients xx, xy, yy and residuals, squared
  std::array<ScalarField, 4> mean_;  // over 24 x 24 pixels
  SceneMotion found_;
};

}  // namespace bolo::motion

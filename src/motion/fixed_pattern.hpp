// The fixed pattern of a camera, learnt from its scene: it stays where it is while the scene moves across it
// (registration-based, scene-based non-uniformity correction). Offsets of single pixels, finer than blocks of 8 x 8:
// patterns that are smooth or constant along the motion, or of a still camera, cannot be separated from the scene.
//
// The innovation z of a moving scene is that of the frame before, moved, whatever the earlier speed; a fixed pattern f
// is in z as it is in the frame. So z_k(p) - f(p) is compared with r(p - d), a mean of pattern-free innovations that
// moves along. Each pixel's f follows the difference as a Kalman filter of one state: fast while little is known,
// slowly afterwards, and hardly where a block differs by more than noise and pattern explain.
#pragma once

#include "src/core/crew.hpp"
#include "src/core/frame.hpp"
#include "src/motion/block_field.hpp"
#include "src/motion/global_motion.hpp"
#include "src/motion/innovation.hpp"

namespace bolo::motion {

// In the values' own unit; times in periods.
struct PatternSettings {
  double noise = 3.0;        // standard deviation of a pixel's noise
  double spread = 10.0;      // of the pattern, before anything is known
  double memory = 60'000.0;  // time constant of the pattern's changes
};

class FixedPattern {
 public:
  // Frames narrower or lower than 24 px show no motion: the pattern stays 0. Thread: setup.
  FixedPattern(Geometry geometry, const Inertia& inertia, const PatternSettings& settings);

  // Resets everything; or only the frame before, because the next one does not follow it. Thread: pipeline.
  void forget() noexcept;
  void skip() noexcept { has_before_ = has_reference_ = false; }
  // The next frame, as it came: row-major. No allocation. Thread: pipeline.
  void learn(const float* frame) noexcept;

  // Subtracts the estimated pattern from these pixels of a frame. Thread: worker.
  void subtract(float* frame, PixelRange pixels) const noexcept;

 private:
  void begin_frame(const float* frame) noexcept;
  void begin_reference() noexcept;
  bool moved_enough() noexcept;
  float newest_of_all() const noexcept;
  void compare() noexcept;
  void follow() noexcept;
  void follow_block(int column, int row) noexcept;

  Geometry geometry_;
  Inertia inertia_;
  double noise_;
  float prior_;             // variance of the pattern before anything is known
  float innovation_noise_;  // variance
  float kept_;              // share of the pattern that persists from one period to the next
  const Kernels& kernels_;
  Alone alone_;
  GlobalMotion global_;
  PaddedPlane pattern_;
  PaddedPlane variance_;  // of the estimate's error
  PaddedPlane now_;       // frames less the pattern
  PaddedPlane before_;
  PaddedPlane innovation_;
  PaddedPlane reference_;  // r
  PaddedPlane moved_;      // r(p - d)
  Pyramid seen_;
  Pyramid seen_before_;
  VectorField displacement_;
  ScalarField excess_;  // mean square of the difference beyond what is expected
  ScalarField mean_;    // of the difference
  ScalarField mismatch_;
  bool has_before_ = false;
  bool has_reference_ = false;
  float reference_noise_ = 1.0F;  // its variance, in units of an innovation's
  int age_ = 0;                   // frames since the reference began
};

}  // namespace bolo::motion

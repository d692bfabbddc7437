// Motion of the scene over the frames that blur a picture, and between them.
//
// Innovations are centred `age` periods before their frames, so that their displacements d_k belong to an earlier time.
// The displacement over [t_{k-i-1}, t_{k-i}] is u_i = d_{k-i} + age (d_{k-i+1} - d_{k-i}); if the next displacement is
// not known yet, it is extrapolated from the last two.
#pragma once

#include <array>

#include "src/motion/global_motion.hpp"
#include "src/motion/innovation.hpp"

namespace bolo::motion {

inline constexpr int kHistory = 8;  // displacements that a path is made of

struct Path {
  Affine trail;                              // u_0: during the estimated frame
  std::array<Affine, kHistory - 1> spans{};  // u_0, u_1 ...
  Affine next;                               // during the frame after
  Affine velocity;                           // for the choice of weights: mostly the velocity that blurred the frame
  std::array<Affine, kPast> past{};          // moves the frames 1, 2, 3 ... before onto the estimated one
  Affine ahead;                              // moves the frame after onto the estimated one
  // Evidence in the last displacements that the motion continues, 1 to 0: a second difference that is large for the
  // speed is a stop, a knock or a cut, of which the newest innovation shows only a part.
  double steady = 1.0;
  Affine displacement;  // of the estimated frame
  int rests = 0;        // number of frames up to the estimated one during which the camera rests, by the gyro
};

using Displacements = std::array<Affine, kHistory>;  // the newest first

// A gyro's d_k, d_{k-1} ... and u_0, u_1 ...
struct GyroMotions {
  Displacements displacements{};
  Displacements spans{};
};

// True if the gyro's residuals `left` change from one to the next by no more than noise, or by less than half (squared)
// of the displacements' changes: constant residuals (a bias, the camera's translation) do no harm, but a gyro that
// misses the changes is of no use. Nor is one that makes the residuals less steady than the displacements, which much
// noise would hide. Thread: any.
bool gyro_agrees(const Displacements& displacements, const Displacements& left, double uncertainty) noexcept;

// `left`: displacements of the newest frame, the one before it and so on, less the gyro's (null: none); with `ahead`
// the first is of the frame after the estimated one. `uncertainty`: the newest one's (GlobalMotion). Thread: any.
Path path_of(const Inertia& inertia, const Displacements& left, bool ahead, double uncertainty = 0.0,
             const GyroMotions* gyro = nullptr) noexcept;

// Extrapolates the displacement after `last` and, before that, `before`. Thread: any.
Affine foretold(const Affine& last, const Affine& before) noexcept;

}  // namespace bolo::motion

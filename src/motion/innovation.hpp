// The innovation: what the scene showed during one frame, which the frame before does not explain.
//
// A pixel of time constant tau that sees x goes from y_{k-1} to y_k = rho y_{k-1} + (1 - rho) x, rho = exp(-T / tau).
// z_k = (y_k - rho y_{k-1}) / (1 - rho) is the mean of x over the frame, its newest part weighing most: blurred by one
// frame instead of the whole past, which makes motion measurable.
#pragma once

#include <cmath>
#include <span>
#include <vector>

#include "src/core/crew.hpp"
#include "src/motion/block_field.hpp"
#include "src/motion/kernels.hpp"
#include "src/motion/padded_plane.hpp"

namespace bolo::motion {

// Least width and height, px, of frames whose motion can be estimated.
inline constexpr int kLeastSide = 24;

// Time constants, periods, that weights are made for. With a shorter one, less of a frame is left in the next than
// floats resolve; tables for longer ones take seconds, and beyond 16,000 periods are not finite.
inline constexpr double kShortestTau = 0.025;
inline constexpr double kLongestTau = 100.0;

struct Inertia {
  double tau = 2.2;  // periods
  double rho = 0.635;

  explicit Inertia(double tau_periods);
  double gain() const { return 1.0 / (1.0 - rho); }
  // Mean age of the innovation's content, periods.
  double age() const { return tau - rho / (1.0 - rho); }
  // Variance of the innovation's noise, and of innovation less frame, in units of the frame's.
  double noise() const { return gain() * gain() * (1.0 + rho * rho); }
  double change_noise() const { return 2.0 * rho * rho * gain() * gain(); }
};

// Variance of the Gaussian that innovations are smoothed with before they are matched, px^2.
inline constexpr float kSmoothing = 1.0F;
// Share of white noise's variance that remains after smoothing.
inline constexpr double kSmoothedNoise = 1.0 / (12.566370614359172 * static_cast<double>(kSmoothing));

// Variance, px^2, that moving by v adds to a smoothed plane, by linear interpolation. Thread: any.
inline float spread_by_moving(float v) noexcept {
  const float part = v - std::floor(v);
  return part * (1.0F - part);
}

// The noise of the frame between two innovations is in both, with opposite signs, which biases matching away from zero
// displacement. Gives its contribution per pixel to the sum of gradient times difference (MatchSums) at displacements
// d, px, in units of a frame's noise variance. Thread: any.
void pull_of_noise(const Kernels& kernels, const Inertia& inertia, std::span<const Vec2> d, Vec2* out) noexcept;

// A smoothed innovation at full size, and repeatedly halved while large enough.
struct Pyramid {
  static constexpr int kMostLevels = 4;
  std::vector<PaddedPlane> level;

  explicit Pyramid(Geometry geometry);
  int levels() const noexcept { return static_cast<int>(level.size()); }
};

// z, extended, and its pyramid. No allocation. Thread: pipeline.
void find_innovation(const Kernels& kernels, const Inertia& inertia, const PaddedPlane& now, const PaddedPlane& before,
                     Crew& crew, PaddedPlane& z, Pyramid& smoothed) noexcept;

}  // namespace bolo::motion

#include "src/motion/path.hpp"

#include <algorithm>
#include <cmath>

namespace bolo::motion {
namespace {

constexpr double kExtrapolated = 0.8;  // of what the last two displacements say of the next
constexpr double kOfThePast = 0.25;    // the past's mean has its share in the weights' velocity
// Of the speed. A stop within the newest frame changes its displacement by little: 4 % would tell every stop in its
// very frame, but costs hands in noise 7 to 25 % more error, which a whole recording has and a stop once.
constexpr double kAbrupt = 0.15;
constexpr double kSlowPan = 3.0;        // px a frame: below it a stop does no harm
constexpr double kUnnoticed = 0.02;     // px a frame: what estimates differ by
constexpr double kTwiceByChance = 8.0;  // twice what a second difference varies by, over what a displacement does
constexpr int kSpans = kHistory - 1;

using Spans = std::array<Affine, kSpans>;  // u_i, the newest first

Spans spans_of(const Inertia& inertia, std::span<const Affine> d) noexcept {
  Spans u;
  for (std::size_t i = 0; i < u.size(); ++i) {
    const Affine change = i == 0 ? (d[0] + d[1] * -1.0) * kExtrapolated : d[i - 1] + d[i] * -1.0;
    u[i] = d[i] + change * inertia.age();
  }
  return u;
}

// The velocity that blurred the frame at the end of span `first`: later spans count for less by rho each.
Affine blurring(const Inertia& inertia, const Spans& u, std::size_t first) noexcept {
  Affine sum;
  double weight = 1.0;
  double total = 0.0;
  for (std::size_t i = first; i + 1 < u.size(); ++i, weight *= inertia.rho) {
    sum = sum + u[i] * weight;
    total += weight;
  }
  return sum * (1.0 / total);
}

// Of the picture's middle.
double steadiness(std::span<const Affine> d, double uncertainty) noexcept {
  const Vec2 last = d[1].at(0.0, 0.0);
  const Vec2 jerk = d[0].at(0.0, 0.0) - last * 2.0F + d[2].at(0.0, 0.0);
  const double speed = std::max<double>(std::hypot(last.x, last.y), kSlowPan);
  const double relative =
      std::max(std::hypot(jerk.x, jerk.y) - kUnnoticed - kTwiceByChance * uncertainty, 0.0) / (kAbrupt * speed);
  return 1.0 / (1.0 + relative * relative * relative * relative);
}

}  // namespace

Path path_of(const Inertia& inertia, std::span<const Affine> displacements, bool ahead, double uncertainty) noexcept {
  const Spans u = spans_of(inertia, displacements);
  const std::size_t now = ahead ? 1 : 0;  // the span that ends at the estimated frame
  const Affine v0 = blurring(inertia, u, now);
  // Frames blurred at other velocities have their scene elsewhere on their trails, whose mean age is tau.
  const auto aligned = [&](const Affine& moved, const Affine& v) {
    return moved + (v0 + v * -1.0) * (-0.5 * inertia.tau);
  };
  Path path;
  path.trail = u[now];
  path.steady = steadiness(displacements, uncertainty);
  Affine moved;
  Affine before;
  for (std::size_t j = 0; j < path.past.size(); ++j) {
    moved = moved + u[now + j];
    const Affine v = blurring(inertia, u, now + j + 1);
    path.past[j] = aligned(moved, v);
    before = before + v * (1.0 / kPast);
  }
  path.velocity = v0 * (1.0 - kOfThePast) + before * kOfThePast;
  if (ahead) path.ahead = aligned(u[0] * -1.0, blurring(inertia, u, 0));
  return path;
}

}  // namespace bolo::motion

#include "src/motion/path.hpp"

#include <algorithm>
#include <cmath>
#include <functional>

namespace bolo::motion {
namespace {

constexpr double kExtrapolated = 0.8;  // of the change between the last two displacements
constexpr double kOfThePast = 0.25;    // share of the past's mean in the weights' velocity
constexpr double kAbrupt = 0.04;       // of the speed: a stop half a frame early changes a displacement by 13 %
constexpr double kSlowPan = 1.5;       // px a frame: below it a stop does no harm
constexpr double kUnnoticed = 0.02;    // px a frame: resolution of estimates
constexpr double kByChance = 8.0;      // bound of a second difference due to noise, in the displacement's uncertainty
constexpr double kOfScatter = 4.8;     // the same for scatter(): twice the standard deviation along one axis
// Of the speed: past second differences up to it count as hand motion, or as noise beyond the uncertainty. A larger
// bound would take noise of .8 K for motion (MotionSafety), a smaller one costs hand motion in .5 K of noise 3 %.
constexpr double kMostUsual = 0.25;
// px of a frame as long as tau: hands reach 3.6 (0.7 px at 200 Hz, 8 at 60); repetitive scenes match at changing
// places.
constexpr double kHop = 4.0;
// With a gyro only the error of straight trails remains, which is below the noise.
constexpr double kWithGyro = 6.0;     // times kByChance
constexpr double kUnexplained = 0.5;  // of the squared changes: share that a gyro may leave unexplained, besides noise
constexpr double kGyroNoise = 0.02;   // px a frame
constexpr double kRest = 0.1;         // px a frame

using Spans = std::array<Affine, kHistory - 1>;  // u_i, the newest first

Spans spans_of(const Inertia& inertia, const Displacements& d, const Displacements& gyro) noexcept {
  Spans u;
  for (std::size_t i = 0; i < u.size(); ++i) {
    const Affine& next = i == 0 ? foretold(d[0], d[1]) : d[i - 1];
    u[i] = gyro[i] + d[i] + (next + d[i] * -1.0) * inertia.age();
  }
  return u;
}

Displacements operator+(const Displacements& a, const Displacements& b) noexcept {
  Displacements sum;
  std::ranges::transform(a, b, sum.begin(), std::plus());
  return sum;
}

// Mean square over the picture's middle row of the component along an axis (0: x, 1: y).
double square(const Affine& a, std::size_t axis) noexcept {
  const double* p = &a.p[3 * axis];
  return p[0] * p[0] + p[1] * p[1] / 3.0;
}

double square(const Affine& a) noexcept { return square(a, 0) + square(a, 1); }

Affine mean_of(const Displacements& d) noexcept {
  Affine sum;
  for (const Affine& one : d) sum = sum + one;
  return sum * (1.0 / kHistory);
}

double variation(const Displacements& d, std::size_t axis) noexcept {
  const Affine mean = mean_of(d);
  double sum = 0.0;
  for (const Affine& one : d) sum += square(one + mean * -1.0, axis);
  return sum;
}

double roughness(const Displacements& d, std::size_t axis) noexcept {
  double sum = 0.0;
  for (std::size_t i = 1; i < d.size(); ++i) sum += square(d[i] + d[i - 1] * -1.0, axis);
  return sum;
}

// The velocity that blurred the frame at the end of span `first`: each earlier span counts less by the factor rho.
// Before the history, the motion of its last spans is assumed.
Affine blurring(const Inertia& inertia, const Spans& u, std::size_t first) noexcept {
  Affine sum;
  double weight = 1.0;
  double total = 0.0;
  for (std::size_t i = std::min(first, u.size() - 2); i + 1 < u.size(); ++i, weight *= inertia.rho) {
    sum = sum + u[i] * weight;
    total += weight;
  }
  return sum * (1.0 / total);
}

// The second difference at displacement `i`, of the picture's middle.
Vec2 change_at(const Displacements& d, std::size_t i) noexcept {
  return d[i].at(0.0, 0.0) - d[i + 1].at(0.0, 0.0) * 2.0F + d[i + 2].at(0.0, 0.0);
}

float jerk(const Displacements& d, std::size_t i) noexcept {
  const Vec2 j = change_at(d, i);
  return std::hypot(j.x, j.y);
}

// Standard deviation of the alternation of the displacements from one to the next, which noise causes and a hand does
// not, along the axis with more of it: neighbouring second differences of white noise have -4 times its variance as
// covariance. From the median product, because a stop affects only one of them.
double scatter(const Displacements& d) noexcept {
  constexpr std::size_t kPairs = kHistory - 3;
  constexpr float kMedian = 2.1F;  // of white noise, in its variances
  std::array<float, kPairs> x{};
  std::array<float, kPairs> y{};
  for (std::size_t i = 0; i < kPairs; ++i) {
    const Vec2 a = change_at(d, i);
    const Vec2 b = change_at(d, i + 1);
    x[i] = a.x * b.x;
    y[i] = a.y * b.y;
  }
  const auto median = [](std::array<float, kPairs>& products) {
    std::ranges::nth_element(products, products.begin() + kPairs / 2);
    return products[kPairs / 2];
  };
  return std::sqrt(std::max(-std::min(median(x), median(y)) / kMedian, 0.0F));
}

// The largest change of the picture's centre that the next one reverses, px a frame.
double hop(const Displacements& d) noexcept {
  double most = 0.0;
  for (std::size_t i = 0; i + 2 < d.size(); ++i) {
    const Vec2 here = d[i + 1].at(0.0, 0.0);
    const Vec2 in = here - d[i + 2].at(0.0, 0.0);
    const Vec2 out = d[i].at(0.0, 0.0) - here;
    if (in.x * out.x + in.y * out.y < 0.0F)
      most = std::max<double>(most, std::min(std::hypot(in.x, in.y), std::hypot(out.x, out.y)));
  }
  return most;
}

double steadiness(const Inertia& inertia, const Displacements& d, double uncertainty, double noise) noexcept {
  const Vec2 last = d[1].at(0.0, 0.0);
  const double speed = std::max<double>(std::hypot(last.x, last.y), kSlowPan);
  const double chance = std::max(kByChance * uncertainty, kOfScatter * noise);
  const double before = std::max({jerk(d, 3), jerk(d, 4), jerk(d, 5)});  // unaffected by the newest changes
  const double usual = std::clamp(before, chance, std::max(chance, kMostUsual * speed));
  const Vec2 more = change_at(d, 0) - change_at(d, 1);  // a turn that continues is no stop
  const double sudden = std::min<double>(jerk(d, 0) - usual, std::hypot(more.x, more.y));
  const double relative = std::max(sudden - kUnnoticed, 0.0) / (kAbrupt * speed + chance);
  const double hops = std::max(hop(d) - kByChance * uncertainty, 0.0) * inertia.tau * inertia.tau / kHop;
  return 1.0 / (1.0 + std::pow(relative, 4.0) + std::pow(hops, 4.0));
}

// James-Stein estimator: shrinks towards the mean by noise's share of the scatter, but nothing by more than twice its
// uncertainty: a wrong gyro does not tell of a stop.
void smooth(Displacements& left, double uncertainty) noexcept {
  const Affine mean = mean_of(left);
  double scatter = 0.0;
  for (const Affine& d : left) scatter += square(d + mean * -1.0) / (kHistory - 1);
  const double chance = 2.0 * (uncertainty * uncertainty + kGyroNoise * kGyroNoise);
  const double keep = std::max(0.0, 1.0 - chance / std::max(scatter, 1e-12));
  for (Affine& d : left) {
    const Affine off = d + mean * -1.0;
    d = mean + off * std::max(keep, 1.0 - std::sqrt(2.0 * chance / std::max(square(off), 1e-12)));
  }
}

bool rests(const Affine& u) noexcept {
  return std::ranges::all_of(u.p, [](double p) { return std::abs(p) < kRest; });
}

}  // namespace

Affine foretold(const Affine& last, const Affine& before) noexcept {
  return last + (last + before * -1.0) * kExtrapolated;
}

bool gyro_agrees(const Displacements& displacements, const Displacements& left, double uncertainty) noexcept {
  const double of_gyro = kHistory * 3.0 * kGyroNoise * kGyroNoise;
  const double chance = kHistory * 9.0 * uncertainty * uncertainty + of_gyro;
  const auto rises = [&](double before, double after) {  // by more than the gyro's noise can add
    return std::sqrt(after) > std::sqrt(before) + std::sqrt(of_gyro);
  };
  return std::ranges::all_of(std::array<std::size_t, 2>{0, 1}, [&](std::size_t axis) {
    const double before = roughness(displacements, axis);
    const double after = roughness(left, axis);
    return after <= kUnexplained * before + chance && !rises(before, after) &&
           !rises(variation(displacements, axis), variation(left, axis));
  });
}

Path path_of(const Inertia& inertia, const Displacements& left, bool ahead, double uncertainty,
             const GyroMotions* gyro) noexcept {
  static constexpr GyroMotions kNothing;
  const GyroMotions& known = gyro != nullptr ? *gyro : kNothing;
  Displacements d = left;
  if (gyro != nullptr) smooth(d, uncertainty);
  const Spans u = spans_of(inertia, d, known.spans);
  const std::size_t now = ahead ? 1 : 0;  // the span that ends at the estimated frame
  const Affine v0 = blurring(inertia, u, now);
  // Frames blurred at other velocities show their scene elsewhere on their trails, whose mean age is tau.
  const auto aligned = [&](const Affine& moved, const Affine& v) {
    return moved + (v0 + v * -1.0) * (-0.5 * inertia.tau);
  };
  Path path;
  path.trail = u[now];
  for (std::size_t i = 0; i < u.size(); ++i) path.spans[i] = u[std::min(now + i, u.size() - 1)];
  path.next = u[0];
  path.displacement = d[now] + known.displacements[now];
  const double noise = gyro == nullptr ? scatter(left) : 0.0;  // a gyro tells stops from noise
  path.steady = std::min({steadiness(inertia, left, uncertainty, noise),
                          steadiness(inertia, d + known.displacements, kWithGyro * uncertainty, noise),
                          steadiness(inertia, d + known.spans, kWithGyro * uncertainty, noise)});
  const Affine mean = mean_of(left);
  for (std::size_t i = now; gyro != nullptr && i < u.size() && rests(mean + gyro->spans[i]); ++i) ++path.rests;
  Affine moved;
  Affine before;
  for (std::size_t j = 0; j < path.past.size(); ++j) {
    moved = moved + u[std::min(now + j, u.size() - 1)];
    const Affine v = blurring(inertia, u, now + j + 1);
    path.past[j] = aligned(moved, v);
    if (j < kNear) before = before + v * (1.0 / kNear);
  }
  path.velocity = v0 * (1.0 - kOfThePast) + before * kOfThePast;
  if (ahead) path.ahead = aligned(u[0] * -1.0, blurring(inertia, u, 0));
  return path;
}

}  // namespace bolo::motion

#include "src/motion/odds.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <numeric>

namespace bolo::motion {
namespace {

constexpr std::size_t kTerms = 16;
constexpr std::array<std::array<float, kTerms>, 2> kOdds = {
    {{-2.29F, 0.85F, -1.52F, 1.03F, 1.14F, -0.83F, 0.53F, 0.40F, 0.21F, 0.0F, 0.0F, 0.0F, -0.26F, 2.03F, 0.57F, 0.22F},
     {-1.35F, 1.78F, 0.89F, 4.50F, 0.35F, -0.97F, 3.07F, 2.96F, 0.21F, 0.75F, -0.71F, -1.60F, -1.0F, 1.0F, 0.0F,
      0.0F}}};                           // with look-ahead
constexpr float kLeastChange = 0.3F;     // noise variances
constexpr float kLeastError = 0.02F;     // noise variances
constexpr float kLeastContrast = 0.01F;  // noise variances
constexpr float kQuiet = 0.3F;           // noise variances: negligible below
constexpr float kAcceptable = 0.3F;      // of the change: acceptable residual in slow motion
constexpr float kFast = 4.0F;            // px a frame: from there on trails are less exact, and other estimates poor
constexpr float kMostFast = 4.0F;        // upper limit, in units of kFast
constexpr float kAware = 0.5F;           // px a frame: up to it a per-pixel estimate's own error estimate is reliable
constexpr float kUnaware = 1.5F;         // from here on it is not
constexpr float kOfChange = 0.5F;   // of the change: bound of a per-pixel estimate's error, twice it in fast motion
constexpr float kExplained = 0.3F;  // of the change: a larger residual is no evidence for the motion
constexpr float kLittle = 0.1F;     // of the change's noise: a smaller change is no evidence either
constexpr float kNearRest = 0.3F;   // px a frame: below it the picture counts as at rest

// Share of what has changed that the motion explains, 0 to 1.
float explained_by_motion(float left, float change, float of_left, float of_change) noexcept {
  const auto beyond = [of_change](float energy, float noise) {
    return std::max(energy - kMargin * noise, 0.0F) + kLittle * of_change;
  };
  return std::max(1.0F - beyond(left, of_left) / beyond(change, of_change) / kExplained, 0.0F);
}

}  // namespace

// The coefficients minimise the blend's error and its excess over mmae's error in any frame or tile of 32 x 32 pixels:
// of 500 random scenes (tests/motion/random_scene.hpp), 252 stretches of pans and hand motion before seven street
// stills, contrast 0.4 and 1.5 K, noise 0.05 to 0.8 K, and of 264 pans and hands before six, contrast to 4.5 K, most of
// them in frames of 640 x 120 pixels: in larger frames the whole picture's motion is known better. Bound beside
// them: MotionGyro's frame after a stop, by a gyro that is late. With look-ahead: of 240 random scenes and 28
// stretches, those of fast hands six times, with `mine` before smoothing across the motion.
//
// A per-pixel estimate ignores the scene that crossed the pixel between two frames, and so underestimates its error in
// fast motion. Where the motion explains the change, the change bounds that error from below, unless the block itself
// does not change (a wall beside a fast texture). The motion explains the change if only noise may be left, or, in fast
// motion, if little of the change is: sharper scenes leave more, by interpolation and slightly wrong trails.
float odds(const Inertia& inertia, bool ahead, const Evidence& e) noexcept {
  const auto of_left = static_cast<float>(inertia.noise());
  const auto of_change = static_cast<float>(inertia.change_noise());
  const float left = std::max(e.left - 0.76F * of_left, 0.0F) + 0.19F * of_left;
  const float change = std::max(e.change - of_change, 0.0F) + kLeastChange;
  const float relative = std::max(e.left - kMargin * of_left, 0.0F) / change /
                         (kAcceptable * std::clamp(e.speed / kFast, 1.0F, kMostFast));
  const float mine = std::log(e.mine + kLeastError);
  const float fast = std::clamp(2.0F * e.speed / kFast - 1.0F, 0.0F, 1.0F);
  const float by_share = fast * explained_by_motion(e.left, e.change, of_left, of_change);
  const float explained = std::max(std::clamp(1.0F + kMargin - e.left / of_left, 0.0F, 1.0F), by_share);
  const float unaware = std::clamp((e.speed - kAware) / (kUnaware - kAware), 0.0F, 1.0F);
  const float here = std::min(e.change - kMargin * of_change, std::max(e.own - of_change, 0.0F));
  const float shown = std::min(e.per_pixel, kOfChange * (1.0F + fast) * std::max(here, 0.0F));
  const float other_error = std::max(e.other, explained * unaware * shown);
  const float other = std::log(other_error + kLeastError);
  const float slow = std::max(1.0F - e.speed / kNearRest, 0.0F);
  const std::array<float, kTerms> terms = {
      1.0F,
      mine,
      other,
      other_error + 1e-3F < kQuiet ? std::log(kQuiet / (other_error + 1e-3F)) : 0.0F,
      std::log(left),
      std::log(change + 0.12F * of_change),
      relative > 0.0F ? std::log(1.0F + relative * relative) : 0.0F,
      e.seen ? 0.0F : 1.0F,
      slow,
      slow * (mine - other),
      ahead ? std::log(0.4F + 2.0F * std::min(e.speed, 100.0F)) : 0.0F,
      unaware * other,
      by_share,
      static_cast<float>(e.bridged),
      std::log(e.apart + kLeastError),
      std::log(e.contrast + kLeastContrast)};
  return std::inner_product(terms.begin(), terms.end(), kOdds[ahead ? 1 : 0].begin(), 0.0F);
}

}  // namespace bolo::motion

// Nothing below a level is told apart.
#include <algorithm>
#include <cmath>
#include <limits>

#include "src/sim/effect_type.hpp"

namespace bolo::sim::effects {
namespace {

constexpr double kCutBelow = 0.15;  // of the scene's span, by default

class ClippedRange final : public Effect {
 public:
  explicit ClippedRange(const EffectSetup& setup) : level_k_(setup.number("level_k")) {
    const Extremes scene = setup.extremes();
    const double span_k = scene.high_k - scene.low_k;
    if (std::isnan(level_k_) && span_k > 0.0) level_k_ = scene.low_k + kCutBelow * span_k;
  }
  void row(const FrameInstant&, int, std::span<double> kelvin) noexcept override {
    if (std::isnan(level_k_)) return;
    for (double& k : kelvin) k = std::max(k, level_k_);
  }

 private:
  double level_k_;
};

}  // namespace

EffectType clipped_range() {
  return {{"clipped_range",
           Stage::kReadout,
           false,
           "values are cut off below a level",
           {{"level_k",
             "K",
             std::numeric_limits<double>::quiet_NaN(),
             {1.0, 2000.0},
             {},
             "lowest value; by default 15 % of the way from the scene's coldest to its hottest"}},
           {}},
          Order::kLimit,
          maker<ClippedRange>()};
}

}  // namespace bolo::sim::effects

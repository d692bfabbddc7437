// Nothing above a level is told apart.
#include <algorithm>
#include <cmath>
#include <limits>

#include "src/sim/effect_type.hpp"

namespace bolo::sim::effects {
namespace {

constexpr double kCutAbove = 0.15;  // of the scene's span, by default

class Saturation final : public Effect {
 public:
  explicit Saturation(const EffectSetup& setup) : level_k_(setup.number("level_k")) {
    const Extremes scene = setup.extremes();
    const double span_k = scene.high_k - scene.low_k;
    if (std::isnan(level_k_) && span_k > 0.0) level_k_ = scene.high_k - kCutAbove * span_k;
  }
  void row(const FrameInstant&, int, std::span<double> kelvin) noexcept override {
    if (std::isnan(level_k_)) return;
    for (double& k : kelvin) k = std::min(k, level_k_);
  }

 private:
  double level_k_;
};

}  // namespace

EffectType saturation() {
  return {{"saturation",
           Stage::kReadout,
           true,
           "values are cut off above a level",
           {{"level_k",
             "K",
             std::numeric_limits<double>::quiet_NaN(),
             {1.0, 2000.0},
             {},
             "highest value; by default 85 % of the way from the scene's coldest to its hottest"}},
           {}},
          Order::kLimit,
          maker<Saturation>()};
}

}  // namespace bolo::sim::effects

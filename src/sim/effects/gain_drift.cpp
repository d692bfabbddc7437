// The gain moves within a capture.
#include <cmath>
#include <numbers>

#include "src/sim/effect_type.hpp"

namespace bolo::sim::effects {
namespace {

class GainDrift final : public Effect {
 public:
  explicit GainDrift(const EffectSetup& setup)
      : amplitude_(setup.number("amplitude")),
        period_s_(setup.number("period_s")),
        reference_k_(setup.number("reference_k")),
        phase_(SplitMix(setup.noise_seed()).between(0.0, 1.0)) {}

  void begin(const FrameInstant& frame) override {
    excess_ = amplitude_ * std::sin(2.0 * std::numbers::pi * (frame.t_s / period_s_ + phase_));
  }
  void row(const FrameInstant&, int, std::span<double> kelvin) noexcept override {
    for (double& k : kelvin) k += excess_ * (k - reference_k_);
  }

 private:
  double amplitude_;
  double period_s_;
  double reference_k_;
  double phase_;
  double excess_ = 0.0;  // gain - 1
};

}  // namespace

EffectType gain_drift() {
  return {{"gain_drift",
           Stage::kReadout,
           false,
           "the gain of all pixels goes up and down, slowly, from an unknown phase on",
           {{"amplitude", "", 0.01, {0.0, 0.5}, {{0.005, 0.02}}, "of the gain about 1"},
            {"period_s", "s", 2.5, {0.05, 1e4}, {}, "of one up and down"},
            {"reference_k", "K", 295.0, {200.0, 400.0}, {}, "the temperature at which the gain makes no difference"}},
           {}},
          Order::kGain,
          maker<GainDrift>()};
}

}  // namespace bolo::sim::effects

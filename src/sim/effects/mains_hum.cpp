// The mains hum through, with opposite signs in the two halves of the read-out.
#include <cmath>
#include <numbers>

#include "src/sim/effect_type.hpp"

namespace bolo::sim::effects {
namespace {

class MainsHum final : public Effect {
 public:
  explicit MainsHum(const EffectSetup& setup)
      : amplitude_k_(setup.number("amplitude_k")),
        frequency_hz_(setup.number("frequency_hz")),
        phase_(SplitMix(setup.noise_seed()).between(0.0, 1.0)),
        height_(setup.geometry().height) {}

  void begin(const FrameInstant& frame) override {
    offset_k_ = amplitude_k_ * std::sin(2.0 * std::numbers::pi * (frequency_hz_ * frame.t_s + phase_));
  }
  void row(const FrameInstant&, int row, std::span<double> kelvin) noexcept override {
    const double offset_k = 2 * row < height_ ? offset_k_ : -offset_k_;
    for (double& k : kelvin) k += offset_k;
  }

 private:
  double amplitude_k_;
  double frequency_hz_;
  double phase_;
  int height_;
  double offset_k_ = 0.0;
};

}  // namespace

EffectType mains_hum() {
  return {{"mains_hum",
           Stage::kReadout,
           false,
           "a sine added to the upper half of the rows and taken from the lower",
           {{"amplitude_k", "K", 0.06, {0.0, 5.0}, {{0.03, 0.1}}, "of the sine"},
            {"frequency_hz", "Hz", 50.0, {0.1, 1000.0}, {}, "of the mains"}},
           {}},
          Order::kOffset,
          maker<MainsHum>()};
}

}  // namespace bolo::sim::effects

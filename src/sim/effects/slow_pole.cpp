// A part of the pixel's answer comes late, as its surroundings warm up.
#include "src/sim/effect_type.hpp"

namespace bolo::sim::effects {
namespace {

class SlowPole final : public Effect {
 public:
  explicit SlowPole(const EffectSetup& setup)
      : share_(setup.number("share")), slow_tau_s_(setup.number("slow_tau_s")) {}
  void configure(CameraModel& model) override {
    model.slow_share = share_;
    model.slow_tau_s = slow_tau_s_;
  }

 private:
  double share_;
  double slow_tau_s_;
};

}  // namespace

EffectType slow_pole() {
  return {{"slow_pole",
           Stage::kPixel,
           true,
           "the answer is (1 - share) / (1 + s tau) + share / (1 + s slow_tau)",
           {{"share", "", 0.02, {0.0, 0.3}, {{0.01, 0.03}}, "of the answer that is slow"},
            {"slow_tau_s", "s", 0.15, {0.02, 2.0}, {{0.06, 0.4}}, "its time constant"}},
           {}},
          Order::kPixel,
          maker<SlowPole>()};
}

}  // namespace bolo::sim::effects

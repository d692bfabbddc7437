// All pixels are slower or faster than stated.
#include "src/sim/effect_type.hpp"

namespace bolo::sim::effects {
namespace {

class TauGlobal final : public Effect {
 public:
  explicit TauGlobal(const EffectSetup& setup) : scale_(setup.number("scale")) {}
  void configure(CameraModel& model) override {
    for (double& tau_s : model.tau_s) tau_s *= scale_;
  }

 private:
  double scale_;
};

}  // namespace

EffectType tau_global() {
  return {{"tau_global",
           Stage::kPixel,
           true,
           "the time constant of every pixel is scaled",
           {{"scale", "", 1.1, {0.5, 2.0}, {{0.85, 0.95}, {1.05, 1.2}}, "of the stated time constant"}},
           {}},
          Order::kPixel,
          maker<TauGlobal>()};
}

}  // namespace bolo::sim::effects

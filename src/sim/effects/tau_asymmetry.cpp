// Pixels cool more slowly than they warm up.
#include "src/sim/effect_type.hpp"

namespace bolo::sim::effects {
namespace {

class TauAsymmetry final : public Effect {
 public:
  explicit TauAsymmetry(const EffectSetup& setup) : scale_(setup.number("scale")) {}
  void configure(CameraModel& model) override { model.falling_scale = scale_; }

 private:
  double scale_;
};

}  // namespace

EffectType tau_asymmetry() {
  return {{"tau_asymmetry",
           Stage::kPixel,
           false,
           "the time constant is another one while a pixel cools",
           {{"scale", "", 1.25, {0.5, 2.0}, {{1.15, 1.4}}, "falling tau / rising tau"}},
           {}},
          Order::kPixel,
          maker<TauAsymmetry>()};
}

}  // namespace bolo::sim::effects

// The pixel is linear in the radiance it gets, not in the temperature that it is read out as.
#include "src/sim/effect_type.hpp"
#include "src/sim/radiance.hpp"

namespace bolo::sim::effects {
namespace {

class RadiometricNonlinearity final : public Effect {
 public:
  explicit RadiometricNonlinearity(const EffectSetup&) {}
  void configure(CameraModel& model) override { model.radiance = true; }
  std::unique_ptr<View> look(std::unique_ptr<View> inner, const CameraModel&) const override {
    return point_view(std::move(inner), [](float kelvin, double, int) {
      return static_cast<float>(radiance_of(static_cast<double>(kelvin)));
    });
  }
};

}  // namespace

EffectType radiometric_nonlinearity() {
  return {{"radiometric_nonlinearity",
           Stage::kRadiometry,
           true,
           "optics and pixels are linear in the radiance from 7.5 to 14 um (Planck); the read-out shows temperature",
           {},
           {}},
          Order::kRadiance,
          maker<RadiometricNonlinearity>()};
}

}  // namespace bolo::sim::effects

// What is seen sends out less than a black body, and reflects its surroundings.
#include "src/sim/effect_type.hpp"
#include "src/sim/radiance.hpp"

namespace bolo::sim::effects {
namespace {

class Emissivity final : public Effect {
 public:
  explicit Emissivity(const EffectSetup& setup)
      : emissivity_(setup.number("emissivity")),
        reflected_((1.0 - emissivity_) * radiance_of(setup.number("surroundings_k"))) {}
  std::unique_ptr<View> look(std::unique_ptr<View> inner, const CameraModel&) const override {
    const double emissivity = emissivity_;
    const double reflected = reflected_;
    return point_view(std::move(inner), [emissivity, reflected](float kelvin, double, int) {
      return static_cast<float>(temperature_of(emissivity * radiance_of(static_cast<double>(kelvin)) + reflected));
    });
  }

 private:
  double emissivity_;
  double reflected_;
};

}  // namespace

EffectType emissivity() {
  return {{"emissivity",
           Stage::kRadiometry,
           true,
           "the radiance is e B(T) + (1 - e) B(T_surroundings), read out as if it were a black body's",
           {{"emissivity", "", 0.96, {0.05, 1.0}, {{0.93, 0.985}}, "e"},
            {"surroundings_k", "K", 295.0, {150.0, 600.0}, {}, "temperature of what is reflected"}},
           {}},
          Order::kEmission,
          maker<Emissivity>()};
}

}  // namespace bolo::sim::effects

// What is seen sends out less than a black body, and reflects its surroundings.
#include "src/sim/effect_type.hpp"
#include "src/sim/radiance.hpp"

namespace bolo::sim::effects {
namespace {

class Emissivity final : public Effect {
 public:
  explicit Emissivity(const EffectSetup& setup)
      : apparent_([e = setup.number("emissivity"), reflected = radiance_of(setup.number("surroundings_k"))](double k) {
          return temperature_of(e * radiance_of(k) + (1.0 - e) * reflected);
        }) {}
  std::unique_ptr<View> look(std::unique_ptr<View> inner, const CameraModel&) const override {
    return point_view(std::move(inner), [this](float kelvin, double, int) {
      return static_cast<float>(apparent_(static_cast<double>(kelvin)));
    });
  }

 private:
  KelvinTable apparent_;
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

// There is more noise, or less, than stated.
#include "src/sim/effect_type.hpp"

namespace bolo::sim::effects {
namespace {

class NoiseLevel final : public Effect {
 public:
  explicit NoiseLevel(const EffectSetup& setup) : scale_(setup.number("scale")) {}
  void configure(CameraModel& model) override { model.noise_scale *= scale_; }

 private:
  double scale_;
};

}  // namespace

EffectType noise_level() {
  return {{"noise_level",
           Stage::kNoise,
           true,
           "the white noise is scaled",
           {{"scale", "", 1.3, {0.1, 10.0}, {{1.12, 1.5}}, "of the stated rms"}},
           {}},
          Order::kOffset,
          maker<NoiseLevel>()};
}

}  // namespace bolo::sim::effects

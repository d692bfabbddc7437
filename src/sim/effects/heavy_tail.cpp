// Noise with outliers.
#include "src/sim/effect_type.hpp"

namespace bolo::sim::effects {
namespace {

class HeavyTail final : public Effect {
 public:
  explicit HeavyTail(const EffectSetup& setup) : degrees_(setup.number("degrees")) {}
  void configure(CameraModel& model) override { model.noise_degrees = degrees_; }

 private:
  double degrees_;
};

}  // namespace

EffectType heavy_tail() {
  return {{"heavy_tail",
           Stage::kNoise,
           true,
           "the noise is Student's t, of the stated rms",
           {{"degrees", "", 4.0, {2.1, 1000.0}, {{3.0, 6.0}}, "of freedom"}},
           {}},
          Order::kOffset,
          maker<HeavyTail>()};
}

}  // namespace bolo::sim::effects

// Heat flows between neighbouring pixels.
#include "src/sim/effect_type.hpp"

namespace bolo::sim::effects {
namespace {

class Crosstalk final : public Effect {
 public:
  explicit Crosstalk(const EffectSetup& setup)
      : coupling_(setup.number("coupling")), neighbours_(static_cast<int>(setup.number("neighbours"))) {}
  void configure(CameraModel& model) override {
    model.coupling = coupling_;
    model.neighbours = neighbours_ >= 6 ? 8 : 4;
  }

 private:
  double coupling_;
  int neighbours_;
};

}  // namespace

EffectType crosstalk() {
  return {{"crosstalk",
           Stage::kPixel,
           true,
           "heat flows between neighbours: tau dT/dt = x - T - coupling * sum (T - T_n)",
           {{"coupling", "", 0.04, {0.0, 1.0}, {{0.02, 0.06}}, "conductance to each neighbour, of the pixel's own"},
            {"neighbours", "", 4.0, {4.0, 8.0}, {}, "4 or 8"}},
           {}},
          Order::kPixel,
          maker<Crosstalk>()};
}

}  // namespace bolo::sim::effects

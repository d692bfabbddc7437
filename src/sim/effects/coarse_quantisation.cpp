// Values in coarser steps than stated.
#include <cmath>

#include "src/sim/effect_type.hpp"

namespace bolo::sim::effects {
namespace {

class CoarseQuantisation final : public Effect {
 public:
  explicit CoarseQuantisation(const EffectSetup& setup) : step_k_(setup.number("step_k")) {}
  void row(const FrameInstant&, int, std::span<double> kelvin) noexcept override {
    for (double& k : kelvin) k = std::round(k / step_k_) * step_k_;
  }

 private:
  double step_k_;
};

}  // namespace

EffectType coarse_quantisation() {
  return {{"coarse_quantisation",
           Stage::kFirmware,
           true,
           "values come in coarser steps",
           {{"step_k", "K", 0.1, {0.001, 20.0}, {{0.1, 0.1}}, "between two values"}},
           {}},
          Order::kOutput,
          maker<CoarseQuantisation>()};
}

}  // namespace bolo::sim::effects

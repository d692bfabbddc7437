// The bias heats the pixels while the frame is read, row after row.
#include <cmath>

#include "src/sim/effect_type.hpp"

namespace bolo::sim::effects {
namespace {

class SelfHeating final : public Effect {
 public:
  explicit SelfHeating(const EffectSetup& setup)
      : amplitude_k_(setup.number("amplitude_k")), height_(setup.geometry().height) {}
  void row(const FrameInstant&, int row, std::span<double> kelvin) noexcept override {
    const double offset_k = -amplitude_k_ * std::expm1(-3.0 * row / height_);
    for (double& k : kelvin) k += offset_k;
  }

 private:
  double amplitude_k_;
  double height_;
};

}  // namespace

EffectType self_heating() {
  return {{"self_heating",
           Stage::kReadout,
           true,
           "an offset that grows within the frame: amplitude * (1 - exp(-3 row / height))",
           {{"amplitude_k", "K", 0.05, {-5.0, 5.0}, {{0.01, 0.1}}, "of the last rows, nearly"}},
           {}},
          Order::kOffset,
          maker<SelfHeating>()};
}

}  // namespace bolo::sim::effects

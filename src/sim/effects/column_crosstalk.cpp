// A part of each pixel's signal is still on the line when the next column is read.
#include "src/sim/effect_type.hpp"

namespace bolo::sim::effects {
namespace {

class ColumnCrosstalk final : public Effect {
 public:
  explicit ColumnCrosstalk(const EffectSetup& setup) : share_(setup.number("share")) {}
  void row(const FrameInstant&, int, std::span<double> kelvin) noexcept override {
    for (std::size_t x = kelvin.size(); x-- > 1;) kelvin[x] += share_ * (kelvin[x - 1] - kelvin[x]);
  }

 private:
  double share_;
};

}  // namespace

EffectType column_crosstalk() {
  return {{"column_crosstalk",
           Stage::kReadout,
           false,
           "each pixel shows a part of the one to its left",
           {{"share", "", 0.04, {0.0, 0.9}, {{0.02, 0.06}}, "of the pixel to the left"}},
           {}},
          Order::kGain,
          maker<ColumnCrosstalk>()};
}

}  // namespace bolo::sim::effects

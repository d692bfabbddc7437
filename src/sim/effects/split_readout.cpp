// Two halves are read at once, from the outer rows to the middle.
#include <algorithm>

#include "src/sim/effect_type.hpp"

namespace bolo::sim::effects {
namespace {

class SplitReadout final : public Effect {
 public:
  explicit SplitReadout(const EffectSetup& setup) : delay_s_(setup.number("row_delay_s")) {}
  void configure(CameraModel& model) override {
    const int height = model.geometry.height;
    for (int row = 0; row < height; ++row) {
      model.row_delay_s[static_cast<std::size_t>(row)] += delay_s_ * std::min(row, height - 1 - row);
    }
  }

 private:
  double delay_s_;
};

}  // namespace

EffectType split_readout() {
  return {{"split_readout",
           Stage::kReadout,
           false,
           "two halves are read at once, in opposite directions, and meet in the middle",
           {{"row_delay_s", "s", 2.8e-5, {-1e-4, 1e-4}, {{1e-5, 4.1e-5}}, "from one sensor row to the next"}},
           {}},
          Order::kPixel,
          maker<SplitReadout>()};
}

}  // namespace bolo::sim::effects

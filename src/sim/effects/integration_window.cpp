// The read-out averages over a part of the frame.
#include "src/sim/effect_type.hpp"

namespace bolo::sim::effects {
namespace {

class IntegrationWindow final : public Effect {
 public:
  explicit IntegrationWindow(const EffectSetup& setup) : window_s_(setup.number("window_s")) {}
  void configure(CameraModel& model) override { model.window_s = window_s_; }

 private:
  double window_s_;
};

}  // namespace

EffectType integration_window() {
  return {{"integration_window",
           Stage::kReadout,
           true,
           "a frame is the mean of what the pixel shows over the window that ends at its time",
           {{"window_s", "s", 0.002, {1e-5, 0.1}, {{0.0005, 0.005}}, "length"}},
           {}},
          Order::kPixel,
          maker<IntegrationWindow>()};
}

}  // namespace bolo::sim::effects

// The lens gives less to the corners.
#include "src/sim/effect_type.hpp"
#include "src/sim/radiance.hpp"

namespace bolo::sim::effects {
namespace {

class Vignetting final : public Effect {
 public:
  explicit Vignetting(const EffectSetup& setup)
      : loss_(setup.number("corner_loss")),
        reference_k_(setup.number("reference_k")),
        middle_x_((setup.geometry().width - 1) / 2.0),
        middle_y_((setup.geometry().height - 1) / 2.0) {}

  // What the lens takes away comes from the camera itself, at its own temperature.
  std::unique_ptr<View> look(std::unique_ptr<View> inner, const CameraModel& model) const override {
    const double own = model.radiance ? radiance_of(reference_k_) : reference_k_;
    const double corner = middle_x_ * middle_x_ + middle_y_ * middle_y_;
    const double bend = corner > 0.0 ? loss_ / corner : 0.0;
    return point_view(std::move(inner), [own, bend, x0 = middle_x_, y0 = middle_y_](float signal, double x, int y) {
      const double square = (x - x0) * (x - x0) + (y - y0) * (y - y0);
      return static_cast<float>(static_cast<double>(signal) - bend * square * (static_cast<double>(signal) - own));
    });
  }

 private:
  double loss_;
  double reference_k_;
  double middle_x_;
  double middle_y_;
};

}  // namespace

EffectType vignetting() {
  return {{"vignetting",
           Stage::kOptics,
           true,
           "the gain falls with the square of the distance from the middle",
           {{"corner_loss", "", 0.01, {0.0, 0.9}, {{0.005, 0.02}}, "of the gain in the corners"},
            {"reference_k", "K", 295.0, {200.0, 400.0}, {}, "the camera's own temperature, which shows in its place"}},
           {}},
          Order::kOptics,
          maker<Vignetting>()};
}

}  // namespace bolo::sim::effects

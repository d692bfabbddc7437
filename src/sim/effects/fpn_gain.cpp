// Each pixel has a gain of its own.
#include "src/sim/effect_type.hpp"

namespace bolo::sim::effects {
namespace {

class FpnGain final : public Effect {
 public:
  explicit FpnGain(const EffectSetup& setup)
      : reference_k_(setup.number("reference_k")),
        width_(static_cast<std::size_t>(setup.geometry().width)),
        excess_(normal_plane(setup.pattern_seed(), setup.geometry())) {
    for (double& excess : excess_) excess *= setup.number("rms");
  }

  void row(const FrameInstant&, int row, std::span<double> kelvin) noexcept override {
    const double* const excess = excess_.data() + static_cast<std::size_t>(row) * width_;
    for (std::size_t x = 0; x < kelvin.size(); ++x) kelvin[x] += excess[x] * (kelvin[x] - reference_k_);
  }

 private:
  double reference_k_;
  std::size_t width_;
  std::vector<double> excess_;  // gain - 1
};

}  // namespace

EffectType fpn_gain() {
  return {{"fpn_gain",
           Stage::kReadout,
           true,
           "a fixed pattern of gains",
           {{"rms", "", 0.006, {0.0, 0.2}, {{0.003, 0.01}}, "of the pixels' gains about 1"},
            {"reference_k", "K", 300.0, {200.0, 400.0}, {}, "the temperature at which the gain makes no difference"}},
           {}},
          Order::kGain,
          maker<FpnGain>()};
}

}  // namespace bolo::sim::effects

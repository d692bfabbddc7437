// Each pixel has a time constant of its own.
#include <algorithm>
#include <cmath>

#include "src/sim/effect_type.hpp"
#include "src/sim/smooth_plane.hpp"

namespace bolo::sim::effects {
namespace {

constexpr double kLeast = 0.2;  // of tau, however wide the spread

class TauSpread final : public Effect {
 public:
  explicit TauSpread(const EffectSetup& setup) : spread_(pattern(setup)) {
    for (double& value : spread_) value *= setup.number("rms");
  }
  void configure(CameraModel& model) override {
    for (std::size_t i = 0; i < spread_.size(); ++i) model.tau_s[i] *= std::max(kLeast, 1.0 + spread_[i]);
  }

 private:
  // Mean 0, variance 1 over the frame.
  static std::vector<double> pattern(const EffectSetup& setup) {
    const std::uint64_t seed = setup.pattern_seed();
    if (setup.form("gradient")) return gradient_plane(seed, setup.geometry());
    if (setup.form("smooth")) return smooth_plane(seed, setup.geometry());
    std::vector<double> white = standardised(normal_plane(key(seed, 1), setup.geometry()));
    if (setup.form("white")) return white;
    const std::vector<double> smooth = smooth_plane(seed, setup.geometry());
    for (std::size_t i = 0; i < white.size(); ++i) white[i] = (white[i] + smooth[i]) * std::sqrt(0.5);
    return standardised(std::move(white));
  }

  std::vector<double> spread_;
};

}  // namespace

EffectType tau_spread() {
  return {{"tau_spread",
           Stage::kPixel,
           true,
           "time constants differ from pixel to pixel; mixed: a white and a smooth pattern of one variance",
           {{"rms", "", 0.04, {0.0, 0.3}, {{0.02, 0.06}}, "of tau, as a fraction of its mean"}},
           {"mixed", "white", "smooth", "gradient"}},
          Order::kPixel,
          maker<TauSpread>()};
}

}  // namespace bolo::sim::effects

// Frames are not taken when their time says.
#include <algorithm>
#include <cmath>

#include "src/sim/effect_type.hpp"

namespace bolo::sim::effects {
namespace {

constexpr double kRare = 0.03;  // of the frames, for the form of few large ones
constexpr double kMost = 0.45;  // of the frame period: frames stay in order

class Jitter final : public Effect {
 public:
  explicit Jitter(const EffectSetup& setup)
      : rms_s_(setup.number("rms_s")),
        most_s_(kMost * setup.period_s()),
        outliers_(setup.form("outliers")),
        seed_(setup.noise_seed()) {}

  void configure(CameraModel& model) override { model.look_ahead_s += most_s_; }

  double shift_s(std::int64_t frame, double) override {
    const auto counter = static_cast<std::uint64_t>(frame);
    double rms_s = rms_s_;
    if (outliers_) rms_s = SplitMix(key(key(seed_, 1), counter)).chance(kRare) ? rms_s_ / std::sqrt(kRare) : 0.0;
    return std::clamp(rms_s * normal(seed_, counter), -most_s_, most_s_);
  }

 private:
  double rms_s_;
  double most_s_;
  bool outliers_;
  std::uint64_t seed_;
};

}  // namespace

EffectType jitter() {
  return {{"jitter",
           Stage::kTransport,
           true,
           "frames are taken earlier or later than t says; outliers: 3 % of them by far, the others exactly",
           {{"rms_s", "s", 5e-4, {0.0, 0.01}, {{2e-4, 8e-4}}, "of the error, at most 45 % of the frame period each"}},
           {"white", "outliers"}},
          Order::kTransport,
          maker<Jitter>()};
}

}  // namespace bolo::sim::effects

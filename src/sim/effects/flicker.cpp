// One offset for the whole frame, new in every frame.
#include <cmath>

#include "src/sim/effect_type.hpp"

namespace bolo::sim::effects {
namespace {

class Flicker final : public Effect {
 public:
  explicit Flicker(const EffectSetup& setup)
      : sigma_k_(setup.number("sigma_k")),
        correlation_(setup.number("correlation")),
        seed_(setup.noise_seed()),
        state_(normal(key(seed_, 0))) {}

  void begin(const FrameInstant& frame) override {
    const double fresh = normal(seed_, static_cast<std::uint64_t>(frame.index));
    state_ = correlation_ * state_ + std::sqrt(1.0 - correlation_ * correlation_) * fresh;
  }

  void row(const FrameInstant&, int, std::span<double> kelvin) noexcept override {
    for (double& k : kelvin) k += sigma_k_ * state_;
  }

 private:
  double sigma_k_;
  double correlation_;
  std::uint64_t seed_;
  double state_;  // unit variance, from its first frame on
};

}  // namespace

EffectType flicker() {
  return {{"flicker",
           Stage::kReadout,
           true,
           "the whole frame has a new offset every time",
           {{"sigma_k", "K", 0.009, {0.0, 5.0}, {{0.004, 0.015}}, "rms of the offsets"},
            {"correlation", "", 0.0, {0.0, 0.95}, {}, "of one frame's offset with the next one's"}},
           {}},
          Order::kOffset,
          maker<Flicker>()};
}

}  // namespace bolo::sim::effects

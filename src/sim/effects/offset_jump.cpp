// The offset jumps, at once and for good.
#include "src/sim/effect_type.hpp"

namespace bolo::sim::effects {
namespace {

class OffsetJump final : public Effect {
 public:
  explicit OffsetJump(const EffectSetup& setup)
      : jump_k_(setup.number("jump_k")),
        at_s_(setup.number("at_s") - 0.5 * setup.period_s()),
        width_(static_cast<std::size_t>(setup.geometry().width)) {
    if (setup.form("pixel")) share_ = normal_plane(setup.pattern_seed(), setup.geometry());
  }

  void row(const FrameInstant& frame, int row, std::span<double> kelvin) noexcept override {
    if (frame.t_s < at_s_) return;
    const std::size_t begin = static_cast<std::size_t>(row) * width_;
    for (std::size_t x = 0; x < kelvin.size(); ++x) kelvin[x] += jump_k_ * (share_.empty() ? 1.0 : share_[begin + x]);
  }

 private:
  double jump_k_;
  double at_s_;
  std::size_t width_;
  std::vector<double> share_;  // each pixel's own; empty: all the same
};

}  // namespace

EffectType offset_jump() {
  return {{"offset_jump",
           Stage::kFirmware,
           true,
           "all values jump between two frames; pixel: each by an amount of its own",
           {{"jump_k", "K", 1.0, {-50.0, 50.0}, {{0.1, 4.0}}, "how far, or the rms of the pixels' own"},
            {"at_s", "s", 0.8, {-1e6, 1e6}, {{0.3, 1.2}}, "when, the capture's time"}},
           {"global", "pixel"}},
          Order::kCorrection,
          maker<OffsetJump>()};
}

}  // namespace bolo::sim::effects

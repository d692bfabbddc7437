// The camera corrects its offsets: the picture freezes behind the shutter, and the pattern is another one afterwards.
#include <algorithm>

#include "src/sim/effect_type.hpp"

namespace bolo::sim::effects {
namespace {

class NucFreeze final : public Effect {
 public:
  explicit NucFreeze(const EffectSetup& setup)
      : from_s_(setup.number("at_s")),
        to_s_(from_s_ + setup.number("freeze_frames") * setup.period_s()),
        half_frame_s_(0.5 * setup.period_s()),
        width_(static_cast<std::size_t>(setup.geometry().width)),
        offset_k_(normal_plane(setup.pattern_seed(), setup.geometry())),
        held_(setup.geometry().pixels()) {
    for (double& offset : offset_k_) offset *= setup.number("offset_k");
  }

  void begin(const FrameInstant& frame) override {
    const double t_s = frame.t_s + half_frame_s_;  // jitter must not move it to another frame
    frozen_ = t_s >= from_s_ && t_s < to_s_ && holds_;
    corrected_ = t_s >= to_s_;
    holds_ = true;
  }

  void row(const FrameInstant&, int row, std::span<double> kelvin) noexcept override {
    const std::size_t begin = static_cast<std::size_t>(row) * width_;
    double* const held = held_.data() + begin;
    if (frozen_) {
      std::copy_n(held, width_, kelvin.begin());
      return;
    }
    for (std::size_t x = 0; corrected_ && x < width_; ++x) kelvin[x] += offset_k_[begin + x];
    std::ranges::copy(kelvin, held);
  }

 private:
  double from_s_;
  double to_s_;
  double half_frame_s_;
  std::size_t width_;
  std::vector<double> offset_k_;
  std::vector<double> held_;  // the last frame before the freeze
  bool holds_ = false;
  bool frozen_ = false;
  bool corrected_ = false;
};

}  // namespace

EffectType nuc_freeze() {
  return {{"nuc_freeze",
           Stage::kFirmware,
           true,
           "the last frame stands for a while, then every pixel has a new offset",
           {{"freeze_frames", "", 80.0, {0.0, 1e6}, {{50.0, 110.0}}, "how long the frame stands"},
            {"offset_k", "K", 0.08, {0.0, 10.0}, {{0.03, 0.08}}, "rms of the new offsets"},
            {"at_s", "s", 0.8, {-1e6, 1e6}, {{0.3, 1.0}}, "when the frame begins to stand, the capture's time"}},
           {}},
          Order::kCorrection,
          maker<NucFreeze>()};
}

}  // namespace bolo::sim::effects

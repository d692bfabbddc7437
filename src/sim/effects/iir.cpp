// The camera's firmware averages over frames.
#include <algorithm>
#include <cmath>

#include "src/sim/effect_type.hpp"

namespace bolo::sim::effects {
namespace {

constexpr double kMotion = 5.0;  // sigma of a change that the adaptive filter takes for motion

class Iir final : public Effect {
 public:
  explicit Iir(const EffectSetup& setup)
      : alpha_(setup.number("alpha")),
        box_(setup.form("box")),
        adaptive_(setup.form("adaptive")),
        motion_k_(kMotion * setup.settings().readout.noise_k),
        width_(static_cast<std::size_t>(setup.geometry().width)),
        state_(setup.geometry().pixels()) {}

  // Until what was before is forgotten to a thousandth.
  void configure(CameraModel& model) override {
    const double frames = alpha_ < 1.0 ? std::ceil(std::log(1e-3) / std::log1p(-alpha_)) : 1.0;
    model.warm_up_frames = std::max(model.warm_up_frames, std::clamp(static_cast<int>(frames), 2, 100));
  }

  void begin(const FrameInstant&) override { first_ = frames_++ == 0; }

  void row(const FrameInstant&, int row, std::span<double> kelvin) noexcept override {
    double* const state = state_.data() + static_cast<std::size_t>(row) * width_;
    for (std::size_t x = 0; x < kelvin.size(); ++x) {
      const double now = kelvin[x];
      const double change = now - state[x];
      const bool moves = adaptive_ && std::abs(change) > motion_k_;
      if (!first_) kelvin[x] = moves ? now : state[x] + alpha_ * change;
      state[x] = box_ ? now : kelvin[x];
    }
  }

 private:
  double alpha_;
  bool box_;
  bool adaptive_;
  double motion_k_;
  std::size_t width_;
  std::uint64_t frames_ = 0;
  bool first_ = true;
  std::vector<double> state_;  // the frame before: as shown, or as read for the box
};

}  // namespace

EffectType iir() {
  return {{"iir",
           Stage::kFirmware,
           true,
           "frames are averaged in time; box: of two frames; adaptive: not where a pixel changes by over 5 sigma",
           {{"alpha", "", 0.75, {0.05, 1.0}, {{0.6, 0.9}}, "weight of the new frame"}},
           {"recursive", "box", "adaptive"}},
          Order::kFilter,
          maker<Iir>()};
}

}  // namespace bolo::sim::effects

// Firmware processing of whole frames: filters, offset corrections, number format.
#include <algorithm>
#include <cmath>

#include "src/sim/effect_type.hpp"

namespace bolo::sim {
namespace {

constexpr double kMotion = 5.0;  // changes above this many sigma count as motion in the adaptive filter

class Iir final : public Effect {
 public:
  explicit Iir(const EffectSetup& setup)
      : alpha_(setup.number("alpha")),
        box_(setup.form("box")),
        adaptive_(setup.form("adaptive")),
        motion_k_(kMotion * setup.settings().readout.noise_k),
        state_(setup.geometry().pixels()) {}

  // Until the initial state has decayed to a thousandth.
  void configure(CameraModel& model) override {
    const double frames = alpha_ < 1.0 ? std::ceil(std::log(1e-3) / std::log1p(-alpha_)) : 1.0;
    model.warm_up_frames = std::max(model.warm_up_frames, std::clamp(static_cast<int>(frames), 2, 100));
  }

  void begin(const FrameInstant&) override { first_ = frames_++ == 0; }

  void row(const FrameInstant&, int row, std::span<double> kelvin) noexcept override {
    const auto state = row_of(state_, row, kelvin.size());
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
  std::uint64_t frames_ = 0;
  bool first_ = true;
  std::vector<double> state_;  // previous frame: output, or input for the box
};

// NUC: the image freezes behind the shutter, and the offset pattern differs afterwards.
class NucFreeze final : public Effect {
 public:
  explicit NucFreeze(const EffectSetup& setup)
      : from_s_(setup.number("at_s")),
        to_s_(from_s_ + setup.number("freeze_frames") * setup.period_s()),
        half_frame_s_(0.5 * setup.period_s()),
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
    const auto held = row_of(held_, row, kelvin.size());
    if (frozen_) {
      std::ranges::copy(held, kelvin.begin());
      return;
    }
    const auto offset_k = row_of(offset_k_, row, kelvin.size());
    for (std::size_t x = 0; corrected_ && x < kelvin.size(); ++x) kelvin[x] += offset_k[x];
    std::ranges::copy(kelvin, held.begin());
  }

 private:
  double from_s_;
  double to_s_;
  double half_frame_s_;
  std::vector<double> offset_k_;
  std::vector<double> held_;  // last frame before the freeze
  bool holds_ = false;
  bool frozen_ = false;
  bool corrected_ = false;
};

auto jump(const EffectSetup& setup) {
  std::vector<double> share(setup.geometry().pixels(), 1.0);
  if (setup.form("pixel")) share = normal_plane(setup.pattern_seed(), setup.geometry());
  return
      [share = std::move(share), jump_k = setup.number("jump_k"), at_s = setup.number("at_s") - 0.5 * setup.period_s()](
          const FrameInstant& frame, int row, std::span<double> kelvin) {
        if (frame.t_s < at_s) return;
        const auto own = row_of(share, row, kelvin.size());
        for (std::size_t x = 0; x < kelvin.size(); ++x) kelvin[x] += jump_k * own[x];
      };
}

auto coarsen(const EffectSetup& setup) {
  return [step_k = setup.number("step_k")](const FrameInstant&, int, std::span<double> kelvin) {
    for (double& k : kelvin) k = std::round(k / step_k) * step_k;
  };
}

}  // namespace

std::vector<EffectType> firmware_effects() {
  return {
      EffectType("iir", Stage::kFirmware, Order::kFilter,
                 "frames are averaged in time; box: of two frames; adaptive: not where a pixel changes by over 5 sigma",
                 {{"alpha", "", 0.75, {0.05, 1.0}, {{0.6, 0.9}}, "weight of the new frame"}},
                 {"recursive", "box", "adaptive"}, maker<Iir>()),
      EffectType("nuc_freeze", Stage::kFirmware, Order::kCorrection,
                 "the last frame stands for a while, then every pixel has a new offset",
                 {{"freeze_frames", "", 80.0, {0.0, 1e6}, {{50.0, 110.0}}, "how long the frame stands"},
                  {"offset_k", "K", 0.08, {0.0, 10.0}, {{0.03, 0.08}}, "rms of the new offsets"},
                  {"at_s", "s", 0.8, {-1e6, 1e6}, {{0.3, 1.0}}, "when the frame begins to stand, the capture's time"}},
                 {}, maker<NucFreeze>()),
      EffectType("offset_jump", Stage::kFirmware, Order::kCorrection,
                 "all values jump between two frames; pixel: each by an amount of its own",
                 {{"jump_k", "K", 1.0, {-50.0, 50.0}, {{0.1, 4.0}}, "how far, or the rms of the pixels' own"},
                  {"at_s", "s", 0.8, {-1e6, 1e6}, {{0.3, 1.2}}, "when, the capture's time"}},
                 {"global", "pixel"}, hooked(jump)),
      EffectType("coarse_quantisation", Stage::kFirmware, Order::kOutput, "values come in coarser steps",
                 {{"step_k", "K", 0.1, {0.001, 20.0}, {{0.1, 0.1}}, "between two values"}}, {}, hooked(coarsen)),
  };
}

}  // namespace bolo::sim

// The package warms up, and offsets with it, slowly and through all captures of a session.
#include <cmath>
#include <numbers>

#include "src/sim/effect_type.hpp"

namespace bolo::sim::effects {
namespace {

class Drift final : public Effect {
 public:
  explicit Drift(const EffectSetup& setup)
      : amplitude_k_(setup.number("amplitude_k")),
        time_s_(setup.number("time_s")),
        sine_(setup.form("sine")),
        phase_(sine_ ? SplitMix(setup.pattern_seed()).between(0.0, 2.0 * std::numbers::pi) : 0.0),
        width_(static_cast<std::size_t>(setup.geometry().width)),
        answer_(normal_plane(setup.pattern_seed(), setup.geometry())) {
    for (double& value : answer_) value = 1.0 + setup.number("spread") * value;
  }

  void begin(const FrameInstant& frame) override {
    const double at = frame.session_s / time_s_;
    const double course =
        sine_ ? std::sin(2.0 * std::numbers::pi * at / kPeriods + phase_) - std::sin(phase_) : -std::expm1(-at);
    offset_k_ = amplitude_k_ * course;
  }

  void row(const FrameInstant&, int row, std::span<double> kelvin) noexcept override {
    const double* const answer = answer_.data() + static_cast<std::size_t>(row) * width_;
    for (std::size_t x = 0; x < kelvin.size(); ++x) kelvin[x] += offset_k_ * answer[x];
  }

 private:
  static constexpr double kPeriods = 4.0;  // time_s of the sine is about from its middle to its top
  double amplitude_k_;
  double time_s_;
  bool sine_;
  double phase_;
  double offset_k_ = 0.0;
  std::size_t width_;
  std::vector<double> answer_;  // of each pixel, 1 on average
};

}  // namespace

EffectType drift() {
  return {{"drift",
           Stage::kPackage,
           true,
           "offsets move with the package's temperature: amplitude * (1 - exp(-t / time)) of the session's time, or "
           "a sine of period 4 * time",
           {{"amplitude_k", "K", 0.09, {-5.0, 5.0}, {{0.03, 0.15}}, "at the end, or of the sine"},
            {"time_s", "s", 10.0, {0.1, 1e4}, {{3.0, 30.0}}, "time constant"},
            {"spread", "", 0.3, {0.0, 2.0}, {}, "rms of the pixels' amplitudes, of their mean"}},
           {"warming", "sine"}},
          Order::kOffset,
          maker<Drift>()};
}

}  // namespace bolo::sim::effects

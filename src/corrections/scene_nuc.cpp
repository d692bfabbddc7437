// Subtracts the fixed pattern, learnt while the scene moves (src/motion/fixed_pattern.hpp). The residual pattern, or
// the one added where there was none, is .2 to .8 of a pixel's noise after 300 frames.
#include <algorithm>
#include <cmath>

#include "src/corrections/correction.hpp"
#include "src/motion/fixed_pattern.hpp"

namespace bolo::corrections {
namespace {

constexpr double kMemoryS = 300.0;      // time constant of an uncooled camera's pattern
constexpr double kSpreadOfNoise = 3.0;  // expected pattern, in units of a pixel's noise
constexpr double kLeastNoise = 0.3;     // counts: rounding alone

motion::PatternSettings settings_of(const Setup& setup, const StreamFormat& input) {
  const double scale = input.scale.unit == Unit::kKelvin ? std::abs(input.scale.scale) : 1.0;
  const double noise = setup.noise_k / scale;
  const double least = input.type == PixelType::kUint16 ? kLeastNoise : 0.0;
  return {.noise = std::max(noise, least),
          .spread = kSpreadOfNoise * std::max(noise, least),
          .memory = kMemoryS / setup.settings.period_s};
}

class SceneNuc final : public Correction {
 public:
  SceneNuc(const Setup& setup, const StreamFormat& input)
      : Correction({.samples = true, .whole_frame = true}),
        learnt_(input.geometry, motion::Inertia(setup.settings.tau_s / setup.settings.period_s),
                settings_of(setup, input)) {}

  void begin(std::uint64_t periods) noexcept override {
    if (periods == 0) learnt_.forget();
    if (periods > 1) learnt_.skip();
  }
  void measure(const float* plane) noexcept override { learnt_.learn(plane); }
  void apply(float* plane, PixelRange pixels) noexcept override { learnt_.subtract(plane, pixels); }

 private:
  motion::FixedPattern learnt_;
};

}  // namespace

Made scene_nuc(const Setup& setup, const StreamFormat& input) {
  if (!setup.undo.scene_nuc) return nullptr;
  return std::make_unique<SceneNuc>(setup, input);
}

}  // namespace bolo::corrections

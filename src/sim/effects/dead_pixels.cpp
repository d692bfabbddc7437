// Pixels that do not answer: stuck at a level, or nothing but noise.
#include <algorithm>
#include <cmath>

#include "src/sim/effect_type.hpp"

namespace bolo::sim::effects {
namespace {

class DeadPixels final : public Effect {
 public:
  explicit DeadPixels(const EffectSetup& setup)
      : seed_(setup.noise_seed()), width_(static_cast<std::size_t>(setup.geometry().width)) {
    const std::size_t size = setup.geometry().pixels();
    const double wanted = setup.number("fraction") * static_cast<double>(size);
    const auto count = wanted > 0.0 ? std::max<std::size_t>(1, static_cast<std::size_t>(std::lround(wanted))) : 0;
    SplitMix random(key(setup.pattern_seed(), 1));
    for (const std::size_t place : choose(setup.pattern_seed(), size, count)) {
      const double level_k = random.between(280.0, 330.0);
      const double noise_k = random.between(10.0, 30.0) * setup.settings().readout.noise_k;
      const bool noisy = random.chance(0.5) ? !setup.form("stuck") : setup.form("noisy");
      pixels_.push_back({place, level_k, noisy ? noise_k : 0.0});
    }
  }

  void row(const FrameInstant& frame, int row, std::span<double> kelvin) noexcept override {
    const std::size_t begin = static_cast<std::size_t>(row) * width_;
    auto pixel = std::ranges::lower_bound(pixels_, begin, {}, &Pixel::place);
    for (; pixel != pixels_.end() && pixel->place < begin + width_; ++pixel) {
      const double noise = normal(key(seed_, pixel->place), static_cast<std::uint64_t>(frame.index));
      kelvin[pixel->place - begin] = pixel->level_k + pixel->noise_k * noise;
    }
  }

 private:
  struct Pixel {
    std::size_t place = 0;
    double level_k = 0.0;
    double noise_k = 0.0;
  };
  std::uint64_t seed_;
  std::size_t width_;
  std::vector<Pixel> pixels_;  // by place
};

}  // namespace

EffectType dead_pixels() {
  return {{"dead_pixels",
           Stage::kPixel,
           true,
           "some pixels do not answer: stuck at a level, or noisy with 10 to 30 times the noise",
           {{"fraction", "", 0.006, {0.0, 0.5}, {{0.003, 0.01}}, "of the pixels, at least one"}},
           {"mixed", "stuck", "noisy"}},
          Order::kDefect,
          maker<DeadPixels>()};
}

}  // namespace bolo::sim::effects

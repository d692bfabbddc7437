// Some pixels jump between two levels: random telegraph signal.
#include <algorithm>
#include <cmath>

#include "src/sim/effect_type.hpp"

namespace bolo::sim::effects {
namespace {

class Rts final : public Effect {
 public:
  explicit Rts(const EffectSetup& setup)
      : step_k_(setup.number("step_k")),
        seed_(setup.noise_seed()),
        width_(static_cast<std::size_t>(setup.geometry().width)),
        chance_(-0.5 * std::expm1(-2.0 * setup.number("rate_hz") * setup.period_s())) {
    const std::size_t size = setup.geometry().pixels();
    const double wanted = setup.number("fraction") * static_cast<double>(size);
    const auto count = wanted > 0.0 ? std::max<std::size_t>(1, static_cast<std::size_t>(std::lround(wanted))) : 0;
    for (const std::size_t place : choose(setup.pattern_seed(), size, count)) {
      pixels_.push_back({place, SplitMix(key(seed_, place)).chance(0.5)});
    }
  }

  void row(const FrameInstant& frame, int row, std::span<double> kelvin) noexcept override {
    const std::size_t begin = static_cast<std::size_t>(row) * width_;
    auto pixel = std::ranges::lower_bound(pixels_, begin, {}, &Pixel::place);
    for (; pixel != pixels_.end() && pixel->place < begin + width_; ++pixel) {
      SplitMix random(key(key(seed_, pixel->place), static_cast<std::uint64_t>(frame.index)));
      if (random.chance(chance_)) pixel->high = !pixel->high;
      kelvin[pixel->place - begin] += pixel->high ? step_k_ / 2.0 : -step_k_ / 2.0;
    }
  }

 private:
  struct Pixel {
    std::size_t place = 0;
    bool high = false;
  };
  double step_k_;
  std::uint64_t seed_;
  std::size_t width_;
  double chance_;  // that a level is another one in the next frame
  std::vector<Pixel> pixels_;
};

}  // namespace

EffectType rts() {
  return {{"rts",
           Stage::kPixel,
           true,
           "some pixels jump between two levels",
           {{"fraction", "", 0.01, {0.0, 0.5}, {{0.005, 0.02}}, "of the pixels, at least one"},
            {"step_k", "K", 0.2, {0.0, 10.0}, {{0.1, 0.3}}, "between the levels"},
            {"rate_hz", "1/s", 3.0, {0.0, 1000.0}, {{1.0, 6.0}}, "jumps a second"}},
           {}},
          Order::kOffset,
          maker<Rts>()};
}

}  // namespace bolo::sim::effects

// Frames whose lower part is still the frame before.
#include <algorithm>

#include "src/sim/effect_type.hpp"

namespace bolo::sim::effects {
namespace {

class TornFrames final : public Effect {
 public:
  explicit TornFrames(const EffectSetup& setup)
      : chance_(setup.number("per_thousand") / 1000.0),
        height_(setup.geometry().height),
        seed_(setup.noise_seed()),
        width_(static_cast<std::size_t>(setup.geometry().width)),
        before_(setup.geometry().pixels()),
        now_(before_.size()) {}

  void begin(const FrameInstant& frame) override {
    before_.swap(now_);
    SplitMix random(key(seed_, static_cast<std::uint64_t>(frame.index)));
    cut_ = height_;
    if (frames_++ > 0 && random.chance(chance_)) {
      cut_ = 1 + static_cast<int>(unit(random.next()) * static_cast<double>(height_ - 1));
    }
  }

  void row(const FrameInstant&, int row, std::span<double> kelvin) noexcept override {
    const std::size_t begin = static_cast<std::size_t>(row) * width_;
    std::copy(kelvin.begin(), kelvin.end(), now_.data() + begin);
    if (row >= cut_) std::copy_n(before_.data() + begin, width_, kelvin.begin());
  }

 private:
  double chance_;
  int height_;
  std::uint64_t seed_;
  std::size_t width_;
  std::uint64_t frames_ = 0;
  int cut_ = 0;  // first row of the frame before
  std::vector<double> before_;
  std::vector<double> now_;
};

}  // namespace

EffectType torn_frames() {
  return {{"torn_frames",
           Stage::kTransport,
           false,
           "in some frames the rows from one on are those of the frame before",
           {{"per_thousand", "", 6.0, {0.0, 1000.0}, {{3.0, 9.0}}, "of the frames"}},
           {}},
          Order::kTransport,
          maker<TornFrames>()};
}

}  // namespace bolo::sim::effects

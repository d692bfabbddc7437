// Frames are lost, or sent twice, and neither the counter nor the time says so.
#include "src/sim/effect_type.hpp"

namespace bolo::sim::effects {
namespace {

class FrameLoss final : public Effect {
 public:
  explicit FrameLoss(const EffectSetup& setup)
      : chance_(setup.number("per_thousand") / 1000.0),
        seed_(setup.noise_seed()),
        only_lost_(setup.form("lost")),
        only_repeated_(setup.form("repeated")) {}

  int frames_lost(std::uint64_t sent) override {
    SplitMix random(key(seed_, sent));
    if (sent == 0 || !random.chance(chance_)) return 0;
    const bool lost = random.chance(0.5) ? !only_repeated_ : only_lost_;
    return lost ? 1 : -1;
  }

 private:
  double chance_;
  std::uint64_t seed_;
  bool only_lost_;
  bool only_repeated_;
};

}  // namespace

EffectType frame_loss() {
  return {{"frame_loss",
           Stage::kTransport,
           true,
           "frames are lost (what follows comes a period early) or sent twice (a period late) with no gap in "
           "frame_id or t",
           {{"per_thousand", "", 6.0, {0.0, 500.0}, {{3.0, 9.0}}, "of the frames"}},
           {"mixed", "lost", "repeated"}},
          Order::kTransport,
          maker<FrameLoss>()};
}

}  // namespace bolo::sim::effects

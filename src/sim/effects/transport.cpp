// Transport of frames, and their times.
#include <algorithm>
#include <cmath>

#include "src/sim/effect_type.hpp"

namespace bolo::sim {
namespace {

auto skew_clock(const EffectSetup& setup) {
  return [skew = setup.number("skew")](std::int64_t, double nominal_s) { return skew * nominal_s; };
}

constexpr double kRare = 0.03;  // fraction of the frames, for rare large outliers
constexpr double kMost = 0.45;  // fraction of the frame period: keeps frames in order

class Jitter final : public Effect {
 public:
  explicit Jitter(const EffectSetup& setup)
      : rms_s_(setup.number("rms_s")),
        most_s_(kMost * setup.period_s()),
        outliers_(setup.form("outliers")),
        seed_(setup.noise_seed()) {}

  void configure(CameraModel& model) override { model.look_ahead_s += most_s_; }

  double shift_s(std::int64_t frame, double) override {
    const auto counter = static_cast<std::uint64_t>(frame);
    double rms_s = rms_s_;
    if (outliers_) rms_s = SplitMix(key(key(seed_, 1), counter)).chance(kRare) ? rms_s_ / std::sqrt(kRare) : 0.0;
    return std::clamp(rms_s * normal(seed_, counter), -most_s_, most_s_);
  }

 private:
  double rms_s_;
  double most_s_;
  bool outliers_;
  std::uint64_t seed_;
};

// Frames are lost or repeated, without a trace in counter or time.
auto lose_frames(const EffectSetup& setup) {
  return [chance = setup.number("per_thousand") / 1000.0, seed = setup.noise_seed(), only_lost = setup.form("lost"),
          only_repeated = setup.form("repeated")](std::uint64_t sent) {
    SplitMix random(key(seed, sent));
    if (sent == 0 || !random.chance(chance)) return 0;
    const bool lost = random.chance(0.5) ? !only_repeated : only_lost;
    return lost ? 1 : -1;
  };
}

// Frames whose lower part is still the previous frame.
class TornFrames final : public Effect {
 public:
  explicit TornFrames(const EffectSetup& setup)
      : chance_(setup.number("per_thousand") / 1000.0),
        height_(setup.geometry().height),
        seed_(setup.noise_seed()),
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
    std::ranges::copy(kelvin, row_of(now_, row, kelvin.size()).begin());
    if (row >= cut_) std::ranges::copy(row_of(before_, row, kelvin.size()), kelvin.begin());
  }

 private:
  double chance_;
  int height_;
  std::uint64_t seed_;
  std::uint64_t frames_ = 0;
  int cut_ = 0;  // first row of the previous frame
  std::vector<double> before_;
  std::vector<double> now_;
};

}  // namespace

std::vector<EffectType> transport_effects() {
  return {
      EffectType("clock_skew", Stage::kTransport, Order::kTransport, "the frame period is not the one that t says",
                 {{"skew", "", 5e-4, {-0.05, 0.05}, {{-1e-3, -1e-4}, {1e-4, 1e-3}}, "true period / stated - 1"}}, {},
                 hooked(skew_clock)),
      EffectType(
          "jitter", Stage::kTransport, Order::kTransport,
          "frames are taken earlier or later than t says; outliers: 3 % of them by far, the others exactly",
          {{"rms_s", "s", 5e-4, {0.0, 0.01}, {{2e-4, 8e-4}}, "of the error, at most 45 % of the frame period each"}},
          {"white", "outliers"}, maker<Jitter>()),
      EffectType("frame_loss", Stage::kTransport, Order::kTransport,
                 "frames are lost (what follows comes a period early) or sent twice (a period late) with no gap in "
                 "frame_id or t",
                 {{"per_thousand", "", 6.0, {0.0, 500.0}, {{3.0, 9.0}}, "of the frames"}},
                 {"mixed", "lost", "repeated"}, hooked(lose_frames)),
      outside_catalogue(EffectType("torn_frames", Stage::kTransport, Order::kTransport,
                                   "in some frames the rows from one on are those of the frame before",
                                   {{"per_thousand", "", 6.0, {0.0, 1000.0}, {{3.0, 9.0}}, "of the frames"}}, {},
                                   maker<TornFrames>())),
  };
}

}  // namespace bolo::sim

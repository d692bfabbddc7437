// A new offset for each column and each row, every frame.
#include "src/sim/effect_type.hpp"

namespace bolo::sim::effects {
namespace {

class Stripes final : public Effect {
 public:
  explicit Stripes(const EffectSetup& setup)
      : column_k_(setup.number("column_k")),
        row_k_(setup.number("row_k")),
        seed_(setup.noise_seed()),
        column_(static_cast<std::size_t>(setup.geometry().width)) {}

  void begin(const FrameInstant& frame) override {
    frame_ = static_cast<std::uint64_t>(frame.index);
    fill_normal(seed_, frame_, 0, column_);
  }

  void row(const FrameInstant&, int row, std::span<double> kelvin) noexcept override {
    const double offset_k = row_k_ * normal(key(seed_, static_cast<std::uint64_t>(row)), frame_);
    for (std::size_t x = 0; x < kelvin.size(); ++x) kelvin[x] += column_k_ * column_[x] + offset_k;
  }

 private:
  double column_k_;
  double row_k_;
  std::uint64_t seed_;
  std::uint64_t frame_ = 0;
  std::vector<double> column_;
};

}  // namespace

EffectType stripes() {
  return {{"stripes",
           Stage::kReadout,
           true,
           "each column and each row has a new offset in every frame",
           {{"column_k", "K", 0.012, {0.0, 5.0}, {{0.006, 0.02}}, "rms of the columns'"},
            {"row_k", "K", 0.006, {0.0, 5.0}, {{0.0, 0.015}}, "rms of the rows'"}},
           {}},
          Order::kOffset,
          maker<Stripes>()};
}

}  // namespace bolo::sim::effects

// The supply of the column amplifiers droops towards the right.
#include <algorithm>

#include "src/sim/effect_type.hpp"

namespace bolo::sim::effects {
namespace {

class ColumnDroop final : public Effect {
 public:
  explicit ColumnDroop(const EffectSetup& setup) : droop_k_(setup.number("droop_k")) {}

  void row(const FrameInstant&, int, std::span<double> kelvin) noexcept override {
    const double last = std::max(1.0, static_cast<double>(kelvin.size()) - 1.0);
    for (std::size_t x = 0; x < kelvin.size(); ++x) kelvin[x] -= droop_k_ * static_cast<double>(x) / last;
  }

 private:
  double droop_k_;
};

}  // namespace

EffectType column_droop() {
  return {{"column_droop",
           Stage::kReadout,
           true,
           "the offset falls from the first column to the last",
           {{"droop_k", "K", 0.05, {0.0, 5.0}, {{0.02, 0.1}}, "between the first column and the last"}},
           {}},
          Order::kOffset,
          maker<ColumnDroop>()};
}

}  // namespace bolo::sim::effects

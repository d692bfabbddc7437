// The supply of the column amplifiers droops towards the right.
#include <algorithm>

#include "src/sim/effect_type.hpp"

namespace bolo::sim {
namespace {

auto droop(const EffectSetup& setup) {
  return [droop_k = setup.number("droop_k")](const FrameInstant&, int, std::span<double> kelvin) {
    const double last = std::max(1.0, static_cast<double>(kelvin.size()) - 1.0);
    for (std::size_t x = 0; x < kelvin.size(); ++x) kelvin[x] -= droop_k * static_cast<double>(x) / last;
  };
}

}  // namespace

std::vector<EffectType> column_droop_effects() {
  return {EffectType(
      "column_droop", Stage::kReadout, Order::kOffset, "the offset falls from the first column to the last",
      {{"droop_k", "K", 0.05, {0.0, 5.0}, {{0.02, 0.1}}, "between the first column and the last"}}, {}, hooked(droop))};
}

}  // namespace bolo::sim

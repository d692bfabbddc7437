#pragma once

#include <vector>

#include "src/sim/effect_type.hpp"

namespace bolo::sim {

// One of each file in src/sim/effects. Thread: any.
std::vector<EffectType> found_effects();

}  // namespace bolo::sim

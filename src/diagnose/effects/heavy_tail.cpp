#include "effect.hpp"

namespace bolo::diagnose {

// Noise with outliers.
extern const Effect heavy_tail_effect{
    .name = "heavy_tail",
    .stage = "noise",
    .needs = "a closed shutter or a flat black body",
    .told_by = [](const Session& s) { return has_kind(s, Kind::kUniform); },
};

}  // namespace bolo::diagnose

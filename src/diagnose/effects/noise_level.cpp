#include "effect.hpp"

namespace bolo::diagnose {

// More noise than the profile says.
extern const Effect noise_level_effect{
    .name = "noise_level",
    .stage = "noise",
    .needs = "a closed shutter or a flat black body",
    .told_by = [](const Session& s) { return has_kind(s, Kind::kUniform); },
};

}  // namespace bolo::diagnose

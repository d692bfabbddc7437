#include "effect.hpp"

namespace bolo::diagnose {

// Pixels that jump between two levels.
extern const Effect rts_effect{
    .name = "rts",
    .stage = "pixel",
    .needs = "a closed shutter over a second or more",
    .told_by = [](const Session& s) { return has_kind(s, Kind::kUniform); },
};

}  // namespace bolo::diagnose

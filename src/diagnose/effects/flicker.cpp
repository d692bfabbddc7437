#include "effect.hpp"

namespace bolo::diagnose {

// A new offset for the whole frame, every frame.
extern const Effect flicker_effect{
    .name = "flicker",
    .stage = "readout",
    .needs = "a closed shutter or a flat black body",
    .told_by = [](const Session& s) { return has_kind(s, Kind::kUniform); },
};

}  // namespace bolo::diagnose

#include "effect.hpp"

namespace bolo::diagnose {

// A new offset for each column or row in every frame.
extern const Effect stripes_effect{
    .name = "stripes",
    .stage = "readout",
    .needs = "a closed shutter or a flat black body",
    .told_by = [](const Session& s) { return has_kind(s, Kind::kUniform); },
};

}  // namespace bolo::diagnose

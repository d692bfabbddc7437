#include "effect.hpp"

namespace bolo::diagnose {

// Values are clipped at a level.
extern const Effect saturation_effect{
    .name = "saturation",
    .stage = "readout",
    .needs = "a capture that reaches the limit",
    .told_by = [](const Session& s) { return !s.recordings.empty(); },
};

}  // namespace bolo::diagnose

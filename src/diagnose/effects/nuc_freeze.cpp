#include "effect.hpp"

namespace bolo::diagnose {

// The shutter: frames frozen, then new offsets.
extern const Effect nuc_freeze_effect{
    .name = "nuc_freeze",
    .stage = "firmware",
    .needs = "a capture in which the shutter closed",
    .told_by = [](const Session& s) { return !s.recordings.empty(); },
};

}  // namespace bolo::diagnose

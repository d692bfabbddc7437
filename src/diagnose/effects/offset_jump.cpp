#include "effect.hpp"

namespace bolo::diagnose {

// A step of the offset at one frame, everywhere.
extern const Effect offset_jump_effect{
    .name = "offset_jump",
    .stage = "firmware",
    .needs = "a capture in which the offset jumped",
    .told_by = [](const Session& s) { return !s.recordings.empty(); },
};

}  // namespace bolo::diagnose

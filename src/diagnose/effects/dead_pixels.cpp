#include "effect.hpp"

namespace bolo::diagnose {

// Pixels that are stuck, or nothing but noise.
extern const Effect dead_pixels_effect{
    .name = "dead_pixels",
    .stage = "pixel",
    .needs = "a closed shutter or a flat black body",
    .told_by = [](const Session& s) { return !s.recordings.empty(); },
};

}  // namespace bolo::diagnose

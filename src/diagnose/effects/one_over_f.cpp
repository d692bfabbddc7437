#include "effect.hpp"

namespace bolo::diagnose {

// Noise of each pixel that grows towards low frequencies.
extern const Effect one_over_f_effect{
    .name = "one_over_f",
    .stage = "pixel",
    .needs = "a closed shutter over a second or more",
    .told_by = [](const Session& s) { return has_kind(s, Kind::kUniform); },
};

}  // namespace bolo::diagnose

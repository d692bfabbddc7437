#include "effect.hpp"

namespace bolo::diagnose {

// A frame filter in the camera: noise_analysis.cpp sees it in the colour of the noise.
extern const Effect iir_effect{
    .name = "iir",
    .stage = "firmware",
    .needs = "a closed shutter or a flat black body",
    .told_by = [](const Session& s) { return has_kind(s, Kind::kUniform); },
};

}  // namespace bolo::diagnose

#include "effect.hpp"

namespace bolo::diagnose {

// Steps between values that are coarser than the profile says.
extern const Effect coarse_quantisation_effect{
    .name = "coarse_quantisation",
    .stage = "firmware",
    .needs = "any capture",
    .told_by = [](const Session& s) { return !s.recordings.empty(); },
};

}  // namespace bolo::diagnose

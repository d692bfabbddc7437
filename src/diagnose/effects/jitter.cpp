#include "effect.hpp"

namespace bolo::diagnose {

// The sampling time of frames varies.
extern const Effect jitter_effect{
    .name = "jitter",
    .stage = "transport",
    .needs = "a pan over bars",
    .told_by = [](const Session& s) { return has_kind(s, Kind::kMovingBars); },
};

}  // namespace bolo::diagnose

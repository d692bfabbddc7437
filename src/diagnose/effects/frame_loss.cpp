#include "effect.hpp"

namespace bolo::diagnose {

// Frames lost or repeated without a gap in the counter.
extern const Effect frame_loss_effect{
    .name = "frame_loss",
    .stage = "transport",
    .needs = "a pan over bars, or a chopper",
    .told_by = [](const Session& s) { return !s.recordings.empty(); },
};

}  // namespace bolo::diagnose

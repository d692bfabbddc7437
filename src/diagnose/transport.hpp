// When frames were taken: losses without a gap in the counter, jitter, from the shifts of moving bars and from the
// delays of a chopper's edges.
#pragma once

#include <vector>

#include "fit.hpp"

namespace bolo::diagnose {

struct Transport {
  int lost = 0;           // frames, in all recordings
  int inserted = 0;       // frames that came in between, not counting identical ones
  double jitter_s = 0.0;  // rms, less what the measurement itself scatters
  double jitter_error_s = 0.0;
  double measured_s = 0.0;  // scatter of the measurement
};

// Finds steps of whole frame periods and the jitter of the rest. Writes each frame's lateness (steps only) to
// state.stimuli[].late_s; choppers are registered anew.
Transport judge_transport(const Session& session, State& state, double floor_k, std::span<const int> pixels);

// The jitter of frames by the shifts of moving bars as they are in `state`. What the model is off by scatters shifts,
// so it is asked again when the effects are known.
void judge_jitter(const Session& session, const State& state, double floor_k, std::span<const int> pixels,
                  Transport& transport);
bool is_jittered(const Transport& transport);

// The state that knows nothing of transport: shifts follow a smooth motion, no frame is late.
State without_transport(const Session& session, const State& state);

}  // namespace bolo::diagnose

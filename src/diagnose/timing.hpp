// When frames were taken and where the pattern was: registration of the stimuli before anything is fitted, losses
// without a gap in the counter, jitter.
#pragma once

#include <vector>

#include "src/diagnose/model.hpp"

namespace bolo::diagnose {

// Brings the recordings' phases and delays near enough for a fit: moving bars frame by frame, still bars, choppers.
// Returns for each recording how well its stimulus correlates with it, 1 for those without a pattern.
std::vector<double> register_stimuli(const Session& session, State& state, std::span<const int> pixels);

// The local speed of moving bars from their shifts: straight lines over some 20 frames.
void smooth_speeds(const Session& session, State& state);

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

// The captures of a session: planned with the rest of the draw, later simulated and written.
#pragma once

#include <filesystem>
#include <vector>

#include "src/core/result.hpp"
#include "tools/lab/blind/dice.hpp"
#include "tools/lab/blind/go_on.hpp"
#include "tools/lab/blind/session.hpp"

namespace bolo::tools::blind {

// Fills in what an effect needs to know of the stimuli: the level of a clipping. Thread: any.
void place_in_scene(sim::EffectSpec& effect, Dice& dice);

// The six captures. An effect that happens at one moment (a shutter, a jump) is at work in one or two of them.
// Thread: any.
std::vector<CapturePlan> plan_captures(const DrawOptions& options, const std::vector<sim::EffectSpec>& effects,
                                       Dice& dice);

// Simulates all captures of a session and writes them to `folder`; the files say nothing of effects, seeds, or how
// the stimulus really was. Returns the files; kFailed when `go_on` says no. Thread: any; writing is serialised inside.
Result<std::vector<std::filesystem::path>> write_captures(
    const Session& session, const std::filesystem::path& folder, const GoOn& go_on = [] { return true; });

}  // namespace bolo::tools::blind

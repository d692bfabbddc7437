// The cameras of `bolo-lab eval loop`: one with an effect, the same without, and what would undo the effect if it were
// known exactly.
#pragma once

#include <cstdint>
#include <vector>

#include "src/core/plane.hpp"
#include "src/core/result.hpp"
#include "src/diagnose/report.hpp"
#include "tools/lab/blind/session.hpp"
#include "tools/lab/eval/recording.hpp"

namespace bolo::tools::loop {

inline constexpr double kSceneSpeedPxS = 60.0;
inline constexpr std::size_t kSceneFrames = 260;

// The camera of the session, with its effects or without, looks at a street that passes by, after the session: the same
// noise either way. What happens at one moment does so in the middle. Thread: any.
Result<Recording> record_scene(const blind::Session& session, bool with_effects);

// What is hidden in the session, in the terms of the pipeline: constants as they were drawn; maps as a bench without
// noise or error would measure them at the scene's time. Thread: any.
Result<diagnose::Learned> true_profile(const blind::Session& session);

// RMSE of the deblurred scene, K, over all frames with a full window behind them, one frame of look-ahead.
// Thread: setup.
Result<double> deblurred_error(const Recording& scene, const diagnose::Learned& known);

}  // namespace bolo::tools::loop

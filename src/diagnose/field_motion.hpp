// What the motion of a scene that nobody knows tells of the camera.
#pragma once

#include <filesystem>
#include <optional>

#include "src/core/result.hpp"
#include "src/diagnose/report.hpp"
#include "src/diagnose/session.hpp"
#include "src/model/camera_profile.hpp"

namespace bolo::diagnose {

// Follows the scene with the estimator of the solver `motion` and looks at
// - contrast against speed: within kStretch frames the scene's spectrum is the same, so a frame's power differs from
//   another's by what a first-order pixel leaves of each spatial frequency on its way: that tells the time constant.
//   Lag says nothing, since the estimated motion lags, too; nor does even motion, which blurs all frames alike.
// - shear against acceleration: rows that are read one after another are displaced by their delay times the change of
//   velocity: that tells the delay.
// Intervals are of a jackknife over stretches of time. Nothing where the frames come too slowly to follow the motion
// between them (period above tau), or too few follow one another. `recording`: of `session`, as read from `file`.
// kBadInput, kFailed: the file cannot be read again. Thread: setup.
Result<std::optional<FromMotion>> learn_from_motion(const std::filesystem::path& file, const Recording& recording,
                                                    const Session& session, const model::CameraProfile& profile);

}  // namespace bolo::diagnose

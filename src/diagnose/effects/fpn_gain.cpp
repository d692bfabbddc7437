#include <algorithm>
#include <cmath>

#include "effect.hpp"

namespace bolo::diagnose {

// Every pixel has a gain of its own.
extern const Effect fpn_gain_effect{
    .name = "fpn_gain",
    .stage = "readout",
    .needs = "flat black bodies at two temperatures",
    .told_by =
        [](const Session& s) {
          return std::ranges::count(s.recordings, Kind::kUniform, &Recording::kind) > 1 || has_kind(s, Kind::kChopper);
        },
    .map = MapKind::kGain,
    .least = 0.00025,
    .report =
        [](const Session& session, const State& s, std::span<const double>, std::span<const double>) {
          const MapSpread spread = spread_of(session, s.camera.gain);
          const double error = 0.71 / std::sqrt(std::max(1.0, spread.pixels));  // of a standard deviation, relative
          const double rms = std::hypot(spread.pixel, spread.column);
          return std::map<std::string, Estimate>{{"rms", interval(rms, 2.0 * error * rms)}};
        },
};

}  // namespace bolo::diagnose

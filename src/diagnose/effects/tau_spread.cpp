#include <cmath>

#include "effect.hpp"

namespace bolo::diagnose {

// Every pixel has a time constant of its own.
extern const Effect tau_spread_effect{
    .name = "tau_spread",
    .stage = "pixel",
    .needs = "a chopper, which shows all pixels the same",
    .told_by = [](const Session& s) { return has_kind(s, Kind::kChopper) || has_kind(s, Kind::kMovingBars); },
    .map = MapKind::kTau,
    .least = 0.002,
    .report =
        [](const Session& session, const State& s, std::span<const double>, std::span<const double>) {
          const MapSpread spread = spread_of(session, s.camera.tau);
          const double error = 0.71 / std::sqrt(std::max(1.0, spread.pixels));  // of a standard deviation, relative
          const double rms = std::hypot(spread.pixel, spread.column);
          return std::map<std::string, Estimate>{{"rms", interval(rms, 2.0 * error * rms)}};
        },
};

}  // namespace bolo::diagnose

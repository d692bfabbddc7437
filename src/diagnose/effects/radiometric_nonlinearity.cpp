#include <cmath>

#include "effect.hpp"

namespace bolo::diagnose {

// The pixel follows radiance, not temperature.
extern const Effect radiometric_nonlinearity_effect{
    .name = "radiometric_nonlinearity",
    .stage = "radiometry",
    .needs = "a chopper with pulses of two heights, or a pan over bars of high contrast",
    .told_by = [](const Session& s) { return has_kind(s, Kind::kChopper) || has_kind(s, Kind::kMovingBars); },
    .coordinates =
        [](const Session& session) {
          static_cast<void>(session);
          return std::vector<Coordinate>{{"share", 0.5, -0.5, 1.5, [](const State& s) { return s.camera.radiance; },
                                          [](State& s, double v) { s.camera.radiance = v; }}};
        },
    .map = MapKind::kNone,
    .least = 0.15,
    .forms = edge_forms(),
    .report =
        [](const Session& session, const State& s, std::span<const double> v, std::span<const double> e) {
          static_cast<void>(session);
          static_cast<void>(s);
          return std::map<std::string, Estimate>{{"share", interval(v[0], e[0])}};
        },
};

}  // namespace bolo::diagnose

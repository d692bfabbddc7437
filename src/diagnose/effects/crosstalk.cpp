#include <cmath>

#include "effect.hpp"

namespace bolo::diagnose {

// Heat that flows to the neighbours.
extern const Effect crosstalk_effect{
    .name = "crosstalk",
    .stage = "pixel",
    .needs = "a still bar target and a pan over it",
    .told_by = [](const Session& s) { return has_kind(s, Kind::kStillBars) || has_kind(s, Kind::kMovingBars); },
    .coordinates =
        [](const Session& session) {
          static_cast<void>(session);
          return std::vector<Coordinate>{{"coupling", 0.02, 0.0, 0.5,
                                          [](const State& s) { return s.camera.response.coupling; },
                                          [](State& s, double v) { s.camera.response.coupling = v; }}};
        },
    .map = MapKind::kNone,
    .least = 0.0015,
    .forms = {},
    .report =
        [](const Session& session, const State& s, std::span<const double> v, std::span<const double> e) {
          static_cast<void>(session);
          static_cast<void>(s);
          return std::map<std::string, Estimate>{{"coupling", interval(v[0], e[0])}};
        },
};

}  // namespace bolo::diagnose

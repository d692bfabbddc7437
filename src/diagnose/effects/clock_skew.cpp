#include <cmath>

#include "effect.hpp"

namespace bolo::diagnose {

// The frame period is not the nominal one. Pans cannot tell it from their own speed; a chopper can.
extern const Effect clock_skew_effect{
    .name = "clock_skew",
    .stage = "transport",
    .needs = "a chopper, or two pans over bars",
    .told_by = [](const Session& s) { return has_kind(s, Kind::kChopper) || has_kind(s, Kind::kMovingBars); },
    .coordinates =
        [](const Session& session) {
          static_cast<void>(session);
          return std::vector<Coordinate>{{"skew", 0.0002, -0.02, 0.02,
                                          [](const State& s) { return s.camera.clock_skew; },
                                          [](State& s, double v) { s.camera.clock_skew = v; }}};
        },
    .map = MapKind::kNone,
    .least = 1e-05,
    .forms = {},
    .report =
        [](const Session& session, const State& s, std::span<const double> v, std::span<const double> e) {
          static_cast<void>(session);
          static_cast<void>(s);
          return std::map<std::string, Estimate>{{"skew", interval(v[0], e[0])}};
        },
};

}  // namespace bolo::diagnose

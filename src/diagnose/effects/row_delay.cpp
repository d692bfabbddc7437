#include <cmath>

#include "effect.hpp"

namespace bolo::diagnose {

// Rows are sampled one after another.
extern const Effect row_delay_effect{
    .name = "row_delay",
    .stage = "readout",
    .needs = "a pan over bars; two of them, in both directions, tell it from an error of the target",
    .told_by = [](const Session& s) { return has_kind(s, Kind::kChopper) || has_kind(s, Kind::kMovingBars); },
    .coordinates =
        [](const Session& session) {
          static_cast<void>(session);
          return std::vector<Coordinate>{{"row_delay_s", 1e-5, -2e-4, 2e-4,
                                          [](const State& s) { return s.camera.row_delay_s; },
                                          [](State& s, double v) { s.camera.row_delay_s = v; }}};
        },
    .map = MapKind::kNone,
    .least = 5e-07,
    .forms = {{"rolling", [](State& s) { s.camera.two_halves = false; }},
              {"halves", [](State& s) { s.camera.two_halves = true; }}},
    .report =
        [](const Session& session, const State& s, std::span<const double> v, std::span<const double> e) {
          static_cast<void>(session);
          static_cast<void>(s);
          return std::map<std::string, Estimate>{{"row_delay_s", interval(v[0], e[0])}};
        },
};

}  // namespace bolo::diagnose

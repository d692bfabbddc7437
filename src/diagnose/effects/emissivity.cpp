#include <cmath>

#include "effect.hpp"

namespace bolo::diagnose {

// What is seen is mixed with the surroundings.
extern const Effect emissivity_effect{
    .name = "emissivity",
    .stage = "radiometry",
    .needs = "black bodies at three temperatures or more",
    .told_by =
        [](const Session& s) {
          return has_kind(s, Kind::kUniform) || has_kind(s, Kind::kChopper) || has_kind(s, Kind::kStillBars) ||
                 has_kind(s, Kind::kMovingBars);
        },
    .coordinates =
        [](const Session& session) {
          static_cast<void>(session);
          return std::vector<Coordinate>{
              {"reflected", 0.03, 0.0, 0.5, [](const State& s) { return s.camera.reflected; },
               [](State& s, double v) { s.camera.reflected = v; }},
              {"surroundings", 0.2, -5.0, 5.0, [](const State& s) { return s.camera.surroundings; },
               [](State& s, double v) { s.camera.surroundings = v; }}};
        },
    .map = MapKind::kNone,
    .least = 0.003,
    .as_levels = true,
    .forms = edge_forms(),
    .report =
        [](const Session& session, const State& s, std::span<const double> v, std::span<const double> e) {
          static_cast<void>(session);
          static_cast<void>(s);
          return std::map<std::string, Estimate>{{"emissivity", interval(1.0 - v[0], e[0])}};
        },
};

}  // namespace bolo::diagnose

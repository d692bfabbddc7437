#include <cmath>

#include "effect.hpp"

namespace bolo::diagnose {

// The read-out averages over a part of the frame. Its mean delay is a start phase; its square is what shows.
extern const Effect integration_window_effect{
    .name = "integration_window",
    .stage = "readout",
    .needs = "a chopper, and pans over bars at two speeds",
    .told_by = [](const Session& s) { return has_kind(s, Kind::kChopper) || has_kind(s, Kind::kMovingBars); },
    .coordinates =
        [](const Session& session) {
          static_cast<void>(session);
          return std::vector<Coordinate>{
              {"window_s2", 4e-6, 0.0, 4e-5,
               [](const State& s) { return s.camera.response.window_s * s.camera.response.window_s; },
               [](State& s, double v) { s.camera.response.window_s = std::sqrt(std::max(0.0, v)); }}};
        },
    .map = MapKind::kNone,
    .least = 4e-08,
    .forms = {},
    .report =
        [](const Session& session, const State& s, std::span<const double> v, std::span<const double> e) {
          static_cast<void>(session);
          static_cast<void>(s);
          return std::map<std::string, Estimate>{{"window_s", root_interval(v[0], e[0])}};
        },
};

}  // namespace bolo::diagnose

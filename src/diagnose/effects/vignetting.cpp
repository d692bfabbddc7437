#include <cmath>

#include "effect.hpp"

namespace bolo::diagnose {

// The gain falls towards the corners, with the square of the radius.
extern const Effect vignetting_effect{
    .name = "vignetting",
    .stage = "optics",
    .needs = "flat black bodies at two temperatures",
    .told_by = [](const Session& s) { return has_kind(s, Kind::kUniform) || has_kind(s, Kind::kChopper); },
    .coordinates =
        [](const Session& session) {
          static_cast<void>(session);
          return std::vector<Coordinate>{
              {"corner_gain", 0.01, -0.2, 0.2, [](const State& s) { return s.camera.corner_gain; },
               [](State& s, double v) { s.camera.corner_gain = v; }},
              {"corner_offset", 0.05, -5.0, 5.0, [](const State& s) { return s.camera.corner_offset; },
               [](State& s, double v) { s.camera.corner_offset = v; }}};
        },
    .map = MapKind::kNone,
    .least = 0.0006,
    .hides_in = MapKind::kGain,
    .report =
        [](const Session& session, const State& s, std::span<const double> v, std::span<const double> e) {
          static_cast<void>(session);
          static_cast<void>(s);
          return std::map<std::string, Estimate>{{"corner_loss", interval(-v[0], e[0])}};
        },
};

}  // namespace bolo::diagnose

#include <cmath>

#include "effect.hpp"

namespace bolo::diagnose {

// Heating by the bias pulse: an offset that grows with the time of the row in the frame.
extern const Effect self_heating_effect{
    .name = "self_heating",
    .stage = "readout",
    .needs = "a closed shutter",
    .told_by = [](const Session& s) { return has_kind(s, Kind::kUniform); },
    .coordinates =
        [](const Session& session) {
          static_cast<void>(session);
          return std::vector<Coordinate>{{"linear", 0.02, -2.0, 2.0, [](const State& s) { return s.camera.row_offset[0]; },
                [](State& s, double v) { s.camera.row_offset[0] = v; }}, {"quadratic", 0.02, -2.0, 2.0, [](const State& s) { return s.camera.row_offset[1]; },
                [](State& s, double v) { s.camera.row_offset[1] = v; }}};
        },
    .map = MapKind::kNone,
    .forms = {},
    .report =
        [](const Session& session, const State& s, std::span<const double> v, std::span<const double> e) {
          static_cast<void>(session);
          static_cast<void>(s);
          return std::map<std::string, Estimate>{{"amplitude_k", interval(std::abs(v[0]) * 2.0, e[0] * 2.0)}};
        },
};

}  // namespace bolo::diagnose

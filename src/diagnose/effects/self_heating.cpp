#include <algorithm>
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
        [](const Session&) {
          return std::vector<Coordinate>{
              {"heating_k", 0.02, -5.0, 5.0, [](const State& s) { return s.camera.heating_k; },
               [](State& s, double v) { s.camera.heating_k = v; }},
              {"log_rate", 0.1, -2.5, 2.5, [](const State& s) { return std::log(s.camera.heating_rate / 3.0); },
               [](State& s, double v) { s.camera.heating_rate = 3.0 * std::exp(v); }}};
        },
    .least = 0.001,
    .hides_in = MapKind::kOffset,
    .report =
        [](const Session&, const State&, std::span<const double> v, std::span<const double> e) {
          return std::map<std::string, Estimate>{{"amplitude_k", interval(std::abs(v[0]), e[0])}};
        },
};

}  // namespace bolo::diagnose

#include <cmath>

#include "effect.hpp"

namespace bolo::diagnose {

// A share of the response follows a second, slower time constant.
extern const Effect slow_pole_effect{
    .name = "slow_pole",
    .stage = "pixel",
    .needs = "a chopper with pulses of several lengths up to 0.3 s",
    .told_by = [](const Session& s) { return has_kind(s, Kind::kChopper); },
    .coordinates =
        [](const Session& session) {
          static_cast<void>(session);
          return std::vector<Coordinate>{
              {"share", 0.01, -0.1, 0.3, [](const State& s) { return s.camera.response.slow_share; },
               [](State& s, double v) { s.camera.response.slow_share = v; }},
              {"log_tau", 0.2, -1.7, 1.7, [](const State& s) { return std::log(s.camera.response.slow_tau_s / 0.15); },
               [](State& s, double v) { s.camera.response.slow_tau_s = 0.15 * std::exp(v); }}};
        },
    .map = MapKind::kNone,
    .least = 0.0012,
    .forms = {{"fast", [](State& s) { s.camera.response.slow_tau_s = 0.07; }},
              {"middle", [](State& s) { s.camera.response.slow_tau_s = 0.15; }},
              {"slow", [](State& s) { s.camera.response.slow_tau_s = 0.35; }}},
    .report =
        [](const Session& session, const State& s, std::span<const double> v, std::span<const double> e) {
          static_cast<void>(session);
          static_cast<void>(s);
          return std::map<std::string, Estimate>{
              {"share", interval(v[0], e[0])},
              {"slow_tau_s",
               {0.15 * std::exp(v[1]), 0.15 * std::exp(v[1] - 1.96 * e[1]), 0.15 * std::exp(v[1] + 1.96 * e[1])}}};
        },
};

}  // namespace bolo::diagnose

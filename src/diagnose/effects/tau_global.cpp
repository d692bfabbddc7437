#include <cmath>

#include "effect.hpp"

namespace bolo::diagnose {

// The time constant of all pixels, as a share of the profile's.
extern const Effect tau_global_effect{
    .name = "tau_global",
    .stage = "pixel",
    .needs = "a chopper, or a pan over bars, whose temperatures change within a few frames",
    .told_by = [](const Session& s) { return has_kind(s, Kind::kChopper) || has_kind(s, Kind::kMovingBars); },
    .coordinates =
        [](const Session& session) {
          static_cast<void>(session);
          return std::vector<Coordinate>{
              {"log_scale", 0.03, -0.7, 0.7,
               [](const State& s) { return std::log(s.camera.response.tau_s / s.camera.nominal_tau_s); },
               [](State& s, double v) { s.camera.response.tau_s = s.camera.nominal_tau_s * std::exp(v); }}};
        },
    .map = MapKind::kNone,
    .least = 0.003,
    .forms = {},
    .report =
        [](const Session& session, const State& s, std::span<const double> v, std::span<const double> e) {
          static_cast<void>(session);
          static_cast<void>(s);
          return std::map<std::string, Estimate>{
              {"scale", {std::exp(v[0]), std::exp(v[0] - 1.96 * e[0]), std::exp(v[0] + 1.96 * e[0])}}};
        },
};

}  // namespace bolo::diagnose

// Effects of the pixel's response in time, and of heat that flows between pixels.
#include <cmath>

#include "src/diagnose/effect.hpp"

namespace bolo::diagnose {
namespace {

constexpr double kSlowTau_s = 0.15;  // about which the second time constant is looked for

// The time constant of all pixels, as a share of the profile's.
Effect tau_global() {
  return {.name = "tau_global",
          .stage = "pixel",
          .needs = "a chopper, or a pan over bars, whose temperatures change within a few frames",
          .told_by = any_of({Kind::kChopper, Kind::kMovingBars}),
          .parameters =
              always({{"log_scale", 0.03, -0.7, 0.7,
                       [](const State& s) { return std::log(s.camera.response.tau_s / s.camera.nominal_tau_s); },
                       [](State& s, double v) { s.camera.response.tau_s = s.camera.nominal_tau_s * std::exp(v); }}}),
          .least = 0.003,
          .report = [](const Fitted& f) {
            return Estimates{{"scale", exp_interval(1.0, f.value[0], f.error[0])}};
          }};
}

// Every pixel has a time constant of its own.
Effect tau_spread() {
  return {.name = "tau_spread",
          .stage = "pixel",
          .needs = "a chopper, which shows all pixels the same",
          .told_by = any_of({Kind::kChopper, Kind::kMovingBars}),
          .map = MapKind::kTau,
          .least = 0.002,
          .report = rms_of(MapKind::kTau)};
}

// A share of the response follows a second, slower time constant.
Effect slow_pole() {
  const auto from = [](double tau_s) { return [tau_s](State& s) { s.camera.response.slow_tau_s = tau_s; }; };
  return {.name = "slow_pole",
          .stage = "pixel",
          .needs = "a chopper with pulses of several lengths up to 0.3 s",
          .told_by = any_of({Kind::kChopper}),
          .parameters = always({number_of("share", 0.01, -0.1, 0.3, &Response::slow_share),
                                {"log_tau", 0.2, -1.7, 1.7,
                                 [](const State& s) { return std::log(s.camera.response.slow_tau_s / kSlowTau_s); },
                                 [](State& s, double v) { s.camera.response.slow_tau_s = kSlowTau_s * std::exp(v); }}}),
          .least = 0.0012,
          .forms = {{"fast", from(0.07)}, {"middle", from(kSlowTau_s)}, {"slow", from(0.35)}},
          .report = [](const Fitted& f) {
            return Estimates{{"share", interval(f.value[0], f.error[0])},
                             {"slow_tau_s", exp_interval(kSlowTau_s, f.value[1], f.error[1])}};
          }};
}

// Heat that flows to the neighbours.
Effect crosstalk() {
  return {.name = "crosstalk",
          .stage = "pixel",
          .needs = "a still bar target and a pan over it",
          .told_by = any_of({Kind::kStillBars, Kind::kMovingBars}),
          .parameters = always({number_of("coupling", 0.02, 0.0, 0.5, &Response::coupling)}),
          .least = 0.0015,
          .report = first_as("coupling")};
}

}  // namespace

std::vector<Effect> pixel_effects() { return {tau_global(), tau_spread(), slow_pole(), crosstalk()}; }

}  // namespace bolo::diagnose

#include "src/diagnose/effect.hpp"

namespace bolo::diagnose {
namespace {

// Contribution of one unit (1 K) of the effect to a value.
CameraModel::Term droop() {
  return {0.0, [](const Place& place, double) { return -place.column; }};
}

CameraModel::Term& term_of(State& state) {
  if (state.camera.terms.empty()) state.camera.terms.push_back(droop());
  return state.camera.terms.front();
}

}  // namespace

// The supply of the column amplifiers droops towards the right.
std::vector<Effect> column_droop_effects() {
  return {{.name = "column_droop",
           .stage = "readout",
           .words = {"Column droop", "The offset falls towards the right"},
           .needs = "a closed shutter",
           .testable_in = any_of({Kind::kUniform}),
           .parameters =
               always({{"droop_k", 0.02, -5.0, 5.0,
                        [](const State& s) { return s.camera.terms.empty() ? 0.0 : s.camera.terms.front().value; },
                        [](State& s, double v) { term_of(s).value = v; }}}),
           .least = 0.002,
           .report = first_as("droop_k")}};
}

}  // namespace bolo::diagnose

// What the report draws.
#pragma once

#include "model.hpp"
#include "session.hpp"
#include "src/diagnose/report.hpp"

namespace bolo::diagnose {

// Fills report.captures, report.maps and the rest of report.location: `raw` with the nominal state before, `session`
// with the diagnosed state after. Thread: setup.
void fill_plots(const Session& raw, const Session& session, const State& nominal, const State& state, double floor_k,
                Report& report);

}  // namespace bolo::diagnose

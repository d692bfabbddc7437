// What is drawn of `bolo-lab eval pulses`.
#pragma once

#include <span>

#include "src/report/sheet.hpp"
#include "tools/lab/eval/pulses_trial.hpp"

namespace bolo::tools {

// Errors and intervals of all trials, and one fit in detail. Thread: any.
plot::Sheet sheet_of(std::span<const PulseScore> scores, const diagnose::PulseFit& example);

}  // namespace bolo::tools

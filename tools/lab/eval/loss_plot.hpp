// What is drawn of `bolo-lab eval loss`.
#pragma once

#include <span>

#include "src/report/sheet.hpp"
#include "tools/lab/eval/loss_trial.hpp"

namespace bolo::tools::faults {

struct LossOutcome {
  LossTask task;
  LossRow row;
};

// Frame rate, latency and error over the share of lost packets. Thread: any.
plot::Sheet sheet_of(std::span<const LossOutcome> outcomes);

}  // namespace bolo::tools::faults

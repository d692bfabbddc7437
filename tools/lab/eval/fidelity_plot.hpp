// What is drawn of `bolo-lab eval fidelity`.
#pragma once

#include "src/report/sheet.hpp"
#include "tools/lab/eval/fidelity_report.hpp"

namespace bolo::tools::fidelity {

// RMSE over look-ahead; then for each scene and look-ahead the RMSE of each estimator relative to the blurred input.
// Thread: any.
plot::Sheet sheet_of(const Table& table);

}  // namespace bolo::tools::fidelity

// What is drawn of `bolo-lab eval detect`.
#pragma once

#include "src/report/sheet.hpp"
#include "tools/lab/detect/options.hpp"
#include "tools/lab/detect/run.hpp"
#include "tools/lab/detect/table.hpp"

namespace bolo::tools::detect {

// For each truth and motion the change of AP of each column with its interval; then for each motion one look as the
// columns show it, with the boxes that one detector found. A page has the table too. Thread: any.
plot::Sheet sheet_of(const Table& table, const Found& found, const Options& options);

}  // namespace bolo::tools::detect

// What is drawn of `bolo-lab eval faults`.
#pragma once

#include <span>
#include <string>
#include <vector>

#include "src/report/sheet.hpp"

namespace bolo::tools::faults {

struct Recovery {
  std::string fault;
  std::vector<double> ms;  // of each run
};

// From a fault's end to undisturbed planes, `window_ms` for comparison. Thread: any.
plot::Sheet sheet_of(std::span<const Recovery> recoveries, double window_ms);

}  // namespace bolo::tools::faults

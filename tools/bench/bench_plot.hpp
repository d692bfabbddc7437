// What is drawn of `bolo bench`.
#pragma once

#include "src/report/sheet.hpp"
#include "tools/bench/deblur_bench.hpp"
#include "tools/bench/readers_bench.hpp"

namespace bolo::tools {

// Time of a frame by solver, instruction set and threads, with the frame period to compare. Thread: any.
plot::Sheet sheet_of(const BenchReport& report);

// What publishing a frame takes, over the number of readers. Thread: any.
plot::Sheet sheet_of(const ReadersReport& report);

}  // namespace bolo::tools

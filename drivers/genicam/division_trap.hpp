// A processor that ends the process over a division.
#pragma once

namespace bolo::genicam {

// The smallest of all integers divided by -1 has no result. Aravis evaluates cameras' formulas, including that
// division, which is a fault of the processor on x86-64 (SIGFPE) and nothing on arm64. From here on its result is 0;
// every other fault is as it was. Thread: any.
void survive_division_of_smallest() noexcept;

}  // namespace bolo::genicam

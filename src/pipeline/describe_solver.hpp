// The settings of a run as one short line for people.
#pragma once

#include <string>
#include <string_view>

#include "src/core/geometry.hpp"
#include "src/deblur/settings.hpp"

namespace bolo::pipeline {

// Method, iterations, lambda, kappa and instruction set: "admm, 8 iterations, lambda 0.002 K, kappa 0.1, AVX3". Short
// enough for the 64 bytes it has in shared memory, whatever the values. Thread: setup.
std::string describe_solver(const deblur::Settings& settings, Unit unit, std::string_view isa);

}  // namespace bolo::pipeline

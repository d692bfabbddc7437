// The kernels' plain twins: one pixel, double precision, full matrices. The vector kernels are tested against them.
#pragma once

#include "src/deblur/grid.hpp"
#include "src/deblur/tuning.hpp"
#include "tests/test.hpp"

namespace bolo::deblur {

// y: one value for each slot; those of lost frames are not looked at. Returns the published value in the units of y.
// Thread: any.
double reference_admm(const Grid& grid, const Tuning& tuning, const Pattern& pattern, std::span<const double> y);

// The same by coordinate descent on the dual; where dual_applies(), without lost frames. Thread: any.
double reference_dual(const Grid& grid, const DualTuning& tuning, const Pattern& pattern, std::span<const double> y);

}  // namespace bolo::deblur

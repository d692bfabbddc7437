// Outliers of the noise: Student's t.
#pragma once

#include <vector>

#include "noise.hpp"

namespace bolo::diagnose {

// Fits degrees of freedom and scale by likelihood to values without their means; n.sigma_tvh is known.
void fit_student(const std::vector<double>& x, NoiseStatistics& n);

}  // namespace bolo::diagnose

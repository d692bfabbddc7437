// The plots of a fit of pulses, as the paper's Fig. 3: one pixel measured against simulated, and what is left.
#pragma once

#include <vector>

#include "src/diagnose/calibrate.hpp"
#include "src/report/plot.hpp"

namespace bolo::tools {

// The whole recording, its most telling switches magnified, and the residual with the noise's width. Empty when the fit
// has no pixel to show. Thread: any.
std::vector<plot::Plot> pulse_plots(const diagnose::PulseFit& fit, double noise_k);

}  // namespace bolo::tools

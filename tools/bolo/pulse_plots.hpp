// Plots of a pulse fit, as in the paper's Fig. 3: measurement and simulation of one pixel, and the residual.
#pragma once

#include <vector>

#include "src/diagnose/calibrate.hpp"
#include "src/report/plot.hpp"

namespace bolo::tools {

// The whole recording, a magnified part with many switches, and the residual with the noise's width. Empty when the fit
// has no pixel to show. Thread: any.
std::vector<plot::Plot> pulse_plots(const diagnose::PulseFit& fit, double noise_k);

}  // namespace bolo::tools

// The picture of a fit of pulses, as the paper's Fig. 3: one pixel measured against simulated, and what is left.
#pragma once

#include <string>

#include "bolo/core/result.hpp"
#include "bolo/diagnose/calibrate.hpp"

namespace bolo::tools {

// Writes a PNG: the whole recording, its most telling switches magnified, and the residual with the noise's width.
// Thread: setup.
Status draw_pulses(const std::string& file, const diagnose::PulseFit& fit, double noise_k);

}  // namespace bolo::tools

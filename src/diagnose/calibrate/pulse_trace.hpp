// What a fit of pulses shows: switching times, levels, one pixel's curve.
#pragma once

#include <cstddef>
#include <vector>

#include "intervals.hpp"
#include "pixel_fit.hpp"
#include "src/diagnose/calibrate.hpp"

namespace bolo::diagnose {

// When the mean signal's input switched, and to which levels: fit.switches_s and fit.levels_k.
void describe_switches(std::span<const double> t_s, const SignalFit& signal, PulseFit& fit);

// Measured and simulated values of the pixel nearest to the middle of the frame among those whose tau is known as well
// as that of most. `signal` has the intervals; levels and amplitudes are the pixel's own. Thread: setup.
Result<PixelTrace> trace_pixel(const FrameSeries& frames, const SignalFit& signal, const PixelTaus& taus,
                               const std::vector<std::size_t>& pixels);

}  // namespace bolo::diagnose

// Stimuli that are not ideal.
#pragma once

#include <memory>

#include "src/sim/stimulus_error.hpp"

namespace bolo::sim {

// A blade that sweeps over `width` columns; levels as given, times shifted by error.start_s.
std::unique_ptr<const Field> make_swept_chopper(capture::Chopper chopper, const StimulusError& error, int width);

// Bars with soft edges that move unevenly; levels as given.
std::unique_ptr<const Field> make_soft_bars(const capture::BarTarget& target, const StimulusError& error);

}  // namespace bolo::sim

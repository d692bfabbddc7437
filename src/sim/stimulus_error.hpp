// Errors of the test bench: deviations from /stimulus. Not an effect of the camera.
#pragma once

#include <limits>
#include <memory>
#include <string>
#include <string_view>

#include "src/sim/field.hpp"

namespace bolo::sim {

// All zero: as stated.
struct StimulusError {
  // Chopper: the blade sweeps over the W columns and reaches column x at sweep_s * (x + 1/2) / W; negative: from the
  // right. A point switches levels within softness_s, centred on that time.
  double sweep_s = 0.0;
  double softness_s = 0.0;
  double start_s = 0.0;  // chopper, moving target: delay of everything

  // Added to the stated temperatures: of the cold level; of the first level (also of the flat field and the hot bars);
  // of the chopper's other levels (NaN: same as the first).
  double cold_k = 0.0;
  double level_k = 0.0;
  double level2_k = std::numeric_limits<double>::quiet_NaN();

  // Bar target. Velocity is stated * (1 + velocity) * (1 + uneven * sin(2 pi (t / uneven_period_s + uneven_phase))).
  double velocity = 0.0;
  double uneven = 0.0;
  double uneven_period_s = 1.0;
  double uneven_phase = 0.0;
  double phase = 0.0;    // shift along +x at t = 0, in periods of the target
  double edge_px = 0.0;  // sigma of the Gaussian that blurs the target's edges along x

  // All stimuli: fraction of the signal that is a reflection of the surroundings.
  double reflection = 0.0;
  double surroundings_k = 295.0;
};

// Parses "key=value,..." with the names above. kBadInput names the nearest key, or the range. Thread: any.
Result<StimulusError> parse_stimulus_error(std::string_view text);

// Inverse of parse_stimulus_error(); empty when there is no error. Thread: any.
std::string stimulus_error_text(const StimulusError& error);

// The real field; its stimulus() stays that of `nominal`. `view`: the frame that sees it. kBadInput when a nonzero
// error does not apply to this stimulus. Thread: setup.
Result<std::unique_ptr<const Field>> with_errors(std::unique_ptr<const Field> nominal, const StimulusError& error,
                                                 Geometry view);

// A blade that sweeps over `width` columns; levels as given, times shifted by error.start_s. Thread: setup.
std::unique_ptr<const Field> make_swept_chopper(capture::Chopper chopper, const StimulusError& error, int width);

// Bars with soft edges and uneven motion; levels as given. Thread: setup.
std::unique_ptr<const Field> make_soft_bars(const capture::BarTarget& target, const StimulusError& error);

}  // namespace bolo::sim

// The stream's properties that every method needs.
#pragma once

#include "src/core/frame.hpp"
#include "src/core/plane.hpp"
#include "src/deblur/settings.hpp"

namespace bolo::deblur {

struct StreamTask {
  Settings settings;
  StreamFormat input;
  PixelType output = PixelType::kUint16;
  double row_period = 0.0;  // from a stored row's sample to the next one's, frame periods

  // Delay of a stored row's sample after the frame's time, frame periods.
  double row_delay(int row) const { return row * row_period; }
  bool delays_rows() const { return row_period != 0.0; }

  // Kelvin a unit of the values; camera counts are taken for 10 mK, as in the A655sc's linear modes.
  double kelvin_per_value() const;
  // A difference of values in the unit that users see: K, or counts.
  double in_kelvin(double value) const;
  // lambda / (2 kappa) in the units of the values.
  double lambda_half() const;
};

// lambda_half in K for which iterations are counted: with automatic lambda, the largest that scenes get.
double lambda_to_tune(const StreamTask& task);

}  // namespace bolo::deblur

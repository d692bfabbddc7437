// What every method needs to know of its stream.
#pragma once

#include "bolo/core/frame.hpp"
#include "bolo/core/plane.hpp"
#include "bolo/deblur/settings.hpp"

namespace bolo::deblur {

struct StreamTask {
  Settings settings;
  StreamFormat input;
  PixelType output = PixelType::kUint16;

  // What one unit of the values is worth, K; camera counts are taken for 10 mK, as in the A655sc's linear modes.
  double kelvin_per_value() const;
  // A difference of values in the unit that users see: K, or counts.
  double in_kelvin(double value) const;
  // lambda / (2 kappa) in the units of the values.
  double lambda_half() const;
};

}  // namespace bolo::deblur

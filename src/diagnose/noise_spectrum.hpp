// The mean spectrum of the pixels' noise: white, 1/f, and a frame filter that both pass.
#pragma once

#include <vector>

#include "noise.hpp"

namespace bolo::diagnose {

struct Spectrum {
  double rate_hz = 200.0;
  std::vector<double> frequency;  // Hz
  std::vector<double> power;      // mean over pixels
  std::vector<double> weight;     // half the degrees of freedom
};

// Fits the spectrum (in order of frequency) by Whittle's likelihood and writes what it says of white noise, corner,
// filter and misfit.
void judge_spectrum(const Spectrum& spectrum, NoiseStatistics& noise);

}  // namespace bolo::diagnose

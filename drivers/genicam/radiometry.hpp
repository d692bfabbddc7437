// Temperatures from the radiance counts of IRFormat = Radiometric.
#pragma once

#include <cstdint>
#include <vector>

#include "drivers/genicam/genicam_source.hpp"

namespace bolo::genicam {

// Calibration of the camera's current range, nodes R, B, F, J0 and J1: the global offset J0 and gain J1 convert counts
// to a radiance signal; R, B and F convert that to a temperature.
struct Planck {
  double r = 0.0;
  double b = 0.0;  // K
  double f = 1.0;
  double j0 = 0.0;  // counts
  double j1 = 1.0;  // counts
};

// Temperature of an object, K; 0 when the count is below all temperatures. As in FLIR's Spinnaker SDK examples and
// FLIR's thermal measurement formula:
//   T = B / ln(R / U + F),  U = (S - J0) / J1 / (e t x) - (1 - e) / e W(reflected) - (1 - t) / (e t) W(atmosphere)
//                               - (1 - x) / (e t x) W(optics),  W(T) = R / (exp(B / T) - F)
// with emissivity e and the transmissions t of the air and x of a window; at unity U = (S - J0) / J1. Temperatures not
// given are 293.15 K. Untested on an A655sc. Thread: any.
double kelvin_of(double count, const Planck& planck, const ObjectParameters& object);

// Temperature of each count in steps of 10 mK, 0 to 65535: 65,536 values. Thread: setup.
std::vector<std::uint16_t> kelvin_table(const Planck& planck, const ObjectParameters& object);

}  // namespace bolo::genicam

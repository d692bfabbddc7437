// FLIR radiometric JPEG stills: converts the stored raw values and constants to kelvin.
#pragma once

#include <filesystem>
#include <span>
#include <string>

#include "src/core/result.hpp"
#include "tools/convert/picture.hpp"

namespace bolo::tools {

// Constants as the camera stores them; temperatures in K.
struct FlirConstants {
  double planck_r1 = 0.0;
  double planck_r2 = 0.0;
  double planck_b = 0.0;  // K
  double planck_f = 1.0;
  double planck_o = 0.0;
  double emissivity = 1.0;
  double distance_m = 0.0;
  double reflected_k = 293.15;
  double atmosphere_k = 293.15;
  double window_k = 293.15;
  double window_transmission = 1.0;
  double humidity = 0.5;  // relative, 0 to 1
  double alpha1 = 0.006569;
  double alpha2 = 0.01262;
  double beta1 = -0.002276;
  double beta2 = -0.00667;
  double x = 1.9;
};

// The radiation formula of FLIR's manuals: raw = w (e t R(T) + (1 - e) t R(reflected) + (1 - t) R(atmosphere)) + (1 -
// w) R(window) with R(T) = R1 / (R2 (exp(B / T) - F)) - O, emissivity e, transmission w of the window and t of the
// atmosphere. Values without a solution T become NaN. Thread: any.
double flir_kelvin(double raw, const FlirConstants& constants);
// t = X exp(-sqrt(d) (alpha1 + beta1 sqrt(h))) + (1 - X) exp(-sqrt(d) (alpha2 + beta2 sqrt(h))), with the water h =
// humidity exp(1.5587 + 0.06939 c - 2.7816e-4 c^2 + 6.8455e-7 c^3) at an air temperature of c degrees Celsius.
double atmosphere_transmission(const FlirConstants& constants);

struct FlirStill {
  Picture raw;
  FlirConstants constants;
  std::string camera_model;
  std::string camera_serial;
};

// Uses exiftool. Errors: not radiometric, constants missing, exiftool not installed. Thread: any.
Result<FlirStill> read_flir_still(const std::filesystem::path& file);

// The still in kelvin, float32; NaN for a pixel without a temperature. Error: all are NaN. Thread: any.
Result<Picture> to_kelvin(const FlirStill& still);

// Most cameras store the 16-bit PNG byte-swapped, some do not: neighbours differ less in the right order. Thread: any.
bool is_byte_swapped(Geometry geometry, std::span<const std::uint16_t> values);

}  // namespace bolo::tools

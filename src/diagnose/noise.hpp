// The noise's own statistics, from recordings of a still field: 3-D noise, colour, tails, lines.
#pragma once

#include <limits>
#include <optional>
#include <string>
#include <vector>

#include "src/diagnose/response.hpp"
#include "src/diagnose/session.hpp"

namespace bolo::diagnose {

// An estimate, and how many of its standard errors lie between it and nothing.
struct Measured {
  double value = 0.0;
  double error = 0.0;
  double z = 0.0;
};

// Components of the temporal noise (NVESD's 3-D noise): every pixel and frame for itself (tvh), a whole frame (t), a
// row (tv) and a column (th) in each frame.
struct NoiseStatistics {
  std::size_t frames = 0;  // of still recordings; 0: nothing is known
  double total_k = 0.0;    // rms of a value about its pixel's mean: the noise floor
  double sigma_tvh = 0.0;
  Measured flicker;  // sigma_t
  Measured rows;     // sigma_tv
  Measured columns;  // sigma_th
  // Whittle's likelihood of the pixels' spectra.
  double white_k = 0.0;  // of the white part, before the frame filter
  Measured corner_hz;    // where 1/f noise equals the white noise
  Measured alpha;        // of the frame filter; value 1: none
  FrameFilter filter = FrameFilter::kNone;
  double spectrum_misfit = 0.0;  // largest |z| of a band of the spectrum against the fit
  // Tails.
  Measured excess_kurtosis;                                  // median over the pixels
  double degrees = std::numeric_limits<double>::infinity();  // of Student's t
  double degrees_error = 0.0;
  // What no effect of the catalogue does.
  double neighbour_row_z = 0.0;     // correlation with the pixel to the left
  double neighbour_column_z = 0.0;  // with the pixel above
  double line_hz = 0.0;
  double line_p = 1.0;  // of the strongest line in the frames' means or in the difference of their halves
  // Slow change of the offset, a cubic in each recording.
  double drift_p = 1.0;
  double drift_k = 0.0;
};

// Of all uniform recordings (or, when there is none, of recordings without a stimulus that are still). Jumps have been
// taken out, bad pixels are marked.
// `ceiling`: recordings with values there are left out.
NoiseStatistics measure_noise(const Session& session, double ceiling);

// Whether nothing moves in a recording without a stimulus.
bool is_still(const Session& session, const Recording& recording);

// A bin of a spectrum.
struct Bin {
  double frequency = 0.0;  // Hz
  double power = 0.0;      // mean over pixels
  double weight = 0.0;     // half the degrees of freedom
};

// Fits the spectrum (in order of frequency) by Whittle's likelihood and writes what it says of white noise, corner,
// filter and misfit.
void judge_spectrum(const std::vector<Bin>& spectrum, double rate_hz, NoiseStatistics& noise);

// Fits degrees of freedom and scale by likelihood to values without their means; n.sigma_tvh is known.
void fit_student(const std::vector<double>& x, NoiseStatistics& n);

// Power in each bin from 0 to half the sampling rate through Hann's window; white noise has its variance in every bin.
std::vector<double> periodogram(const Eigen::ArrayXd& x);

}  // namespace bolo::diagnose

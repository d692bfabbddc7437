// Judging the pixels of a fit: which can be trusted, which are dead, what they have in common.
#pragma once

#include <cstddef>
#include <vector>

#include "common_signal.hpp"
#include "pixel_fit.hpp"

namespace bolo::diagnose {

// A pixel's residual says what its noise is, but roughly in a short recording: the usual noise counts as so many frames
// more.
void settle_errors(const DecayTable& table, const std::vector<std::int8_t>& follows, PixelTaus& taus);

// Pixels that follow too noisily or weakly, and those that don't although their neighbours do.
std::vector<DeadPixel> find_dead(const FrameSeries& frames, const CommonSignal& common, const PixelTaus& taus);

// Pixels that are good, as well known as most, and not far off the others.
std::vector<std::size_t> trusted(const PixelTaus& taus, const std::vector<DeadPixel>& dead);

// Mean and spread of the pixels' taus when each has a standard error (random effects, DerSimonian and Laird 1986).
struct Population {
  double mean_s = 0.0;
  double error = 0.0;        // of the mean, relative
  double noise_error = 0.0;  // the share of it that comes from the pixels' errors
  double spread = 0.0;       // rms, relative
  double spread_z = 0.0;
  std::size_t pixels = 0;
};

Population population(const PixelTaus& taus, const std::vector<std::size_t>& pixels);

// Each trusted pixel's tau, s, shrunk to the mean by its reliability; the mean elsewhere.
std::vector<float> shrunk_map(const PixelTaus& taus, const std::vector<std::size_t>& pixels, const Population& all);

// Rms of the residuals of these pixels.
double rms_left(const PixelTaus& taus, const std::vector<std::size_t>& pixels);

// Noise of the pixels, from what two frames say about the third: between switches L + A exp(-t / tau) leaves nothing of
// (y2 - y1) - r (y1 - y0). In the late half of each interval, so that a small
// error of tau doesn't count.
Result<double> late_noise(const FrameSeries& frames, const DecayTable& table, const PixelTaus& taus,
                          const std::vector<std::size_t>& pixels, const Progress& progress);

}  // namespace bolo::diagnose

// From events to the noise's own statistics, and what they name.
#include <algorithm>
#include <cmath>

#include "src/diagnose/stages.hpp"

namespace bolo::diagnose {
namespace {

// Sessions without any effect stay below all of these.
constexpr double kLeastComponent = 0.0015;   // K, of flicker and stripes
constexpr double kClear = 8.0;               // standard errors
constexpr double kClearCorner = 5.0;         // the same of 1/f noise, which has few bins
constexpr double kLeastCorner = 0.08;        // Hz
constexpr double kLeastKurtosis = 0.25;      // in excess of a Gaussian's
constexpr double kClearLine = 1e-6;          // p-value
constexpr double kClearMisfit = 7.0;         // standard errors of a band of the spectrum
constexpr double kLeastScale = 1.04;         // of the noise's level
constexpr double kLeastScaleOfTails = 1.12;  // the same where outliers add to it
constexpr double kScaleError = 0.004;        // relative, of the level

double confidence_from(double z) { return 1.0 - 0.5 * std::erfc(std::min(z, 6.0) / 2.0); }

bool shows(const Measured& component) { return component.z > kClear && component.value > kLeastComponent; }

// Of one value, K rms; what was measured where there is no kelvin.
double nominal_noise(const Session& session, const NoiseStatistics& statistics, const model::CameraProfile& p) {
  if (!session.recordings.front().kelvin) return statistics.white_k;
  return std::sqrt(p.noise_k * p.noise_k + p.quantisation_k * p.quantisation_k / 12.0);
}

double floor_of(const Events& events, const Noise& noise, const model::CameraProfile& p) {
  const NoiseStatistics& s = noise.statistics;
  const double floor_k = s.frames > 0 && s.total_k > 0.0 ? s.total_k : noise.nominal_k;
  if (!events.coarse || p.quantisation_k <= 0.0) return floor_k;
  // A still field sits at one place between two steps; what moves sees the whole step.
  return std::max(floor_k, std::sqrt(p.noise_k * p.noise_k + events.step_k * events.step_k / 12.0));
}

class Namer {
 public:
  Namer(const Options& options, Findings& findings) : options_(options), findings_(findings) {}
  void name(const std::string& name, double z, std::map<std::string, Estimate> parameters, const std::string& where) {
    FoundEffect e = named(name, confidence_from(z), std::move(parameters));
    e.of_noise = true;
    add(findings_, options_, std::move(e), z, where);
  }
  void remain(const std::string& stage, const std::string& where, double z) {
    findings_.remainders.push_back({stage, where, z, std::nullopt, false});
  }

 private:
  const Options& options_;
  Findings& findings_;
};

// Whole frames, rows and columns.
void name_components(const NoiseStatistics& n, Namer& out) {
  if (shows(n.flicker)) {
    out.name("flicker", n.flicker.z, {{"sigma_k", interval(n.flicker.value, n.flicker.error)}},
             "whole frames differ by an offset");
  }
  if (shows(n.rows) || shows(n.columns)) {
    out.name(
        "stripes", std::max(n.rows.z, n.columns.z),
        {{"column_k", interval(n.columns.value, n.columns.error)}, {"row_k", interval(n.rows.value, n.rows.error)}},
        "rows or columns differ by an offset in every frame");
  }
}

void name_spectrum_and_tails(const Noise& noise, bool coarse, const model::CameraProfile& p, Namer& out) {
  const NoiseStatistics& n = noise.statistics;
  if (n.filter != FrameFilter::kNone) {
    out.name("iir", n.alpha.z, {{"alpha", interval(n.alpha.value, n.alpha.error)}},
             "the noise is correlated from frame to frame");
  }
  if (n.corner_hz.z > kClearCorner && n.corner_hz.value > kLeastCorner) {
    out.name("one_over_f", n.corner_hz.z, {{"corner_hz", interval(n.corner_hz.value, n.corner_hz.error)}},
             "the noise grows towards low frequencies");
  }
  const bool tails = n.excess_kurtosis.z > kClear && n.excess_kurtosis.value > kLeastKurtosis && !coarse;
  if (tails) {
    out.name("heavy_tail", n.excess_kurtosis.z, {{"degrees", interval(n.degrees, n.degrees_error)}},
             "the noise has outliers");
  }
  const double scale = n.white_k / noise.nominal_k;
  if (scale > (tails ? kLeastScaleOfTails : kLeastScale) && !coarse) {
    const double error = kScaleError * scale;
    const double quantisation2 = p.quantisation_k * p.quantisation_k / 12.0;
    const double own = std::sqrt(std::max(0.0, n.white_k * n.white_k - quantisation2)) / p.noise_k;
    out.name("noise_level", (scale - 1.0) / error, {{"scale", interval(own, error)}},
             "the noise is stronger than the profile says");
  }
}

// What no effect of the catalogue does.
void name_rest(const NoiseStatistics& n, bool coarse, Namer& out) {
  if (n.line_p < kClearLine) {
    out.remain("readout",
               "a line at " + std::to_string(static_cast<int>(std::lround(n.line_hz))) +
                   " Hz in the means of frames or of their halves",
               kClear);
  }
  // Neighbours that share noise: what flicker and stripes leave is taken out already.
  if (std::abs(n.neighbour_row_z) > kClear) {
    out.remain("readout", "the noise of a pixel shows in its neighbour in the row", std::abs(n.neighbour_row_z));
  }
  if (std::abs(n.neighbour_column_z) > kClear) {
    out.remain("readout", "the noise of a pixel shows in its neighbour in the column", std::abs(n.neighbour_column_z));
  }
  if (n.spectrum_misfit > kClearMisfit && !coarse) {
    out.remain("noise", "the noise's spectrum has a shape that no effect gives it", n.spectrum_misfit);
  }
}

}  // namespace

Noise judge_noise(const Events& events, const Options& options) {
  Noise noise;
  noise.statistics = measure_noise(events.session, events.ceiling_k);
  noise.nominal_k = nominal_noise(events.session, noise.statistics, options.profile);
  noise.floor_k = floor_of(events, noise, options.profile);
  // Counts cannot be compared with a profile in kelvin.
  const Recording& first = events.session.recordings.front();
  if (!first.kelvin) {
    noise.findings.warnings.push_back(
        first.name +
        ": holds counts, not kelvin; names that end in _k stand for counts, and the noise's level is not judged");
  }
  if (noise.statistics.frames == 0) return noise;
  Namer out(options, noise.findings);
  name_components(noise.statistics, out);
  name_spectrum_and_tails(noise, events.coarse, options.profile, out);
  name_rest(noise.statistics, events.coarse, out);
  return noise;
}

}  // namespace bolo::diagnose

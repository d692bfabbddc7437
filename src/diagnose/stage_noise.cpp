// Likelihood fits of the noise (spectrum, tails of the distribution), and effects identified by noise statistics.
#include <complex>

#include <unsupported/Eigen/FFT>

#include "src/diagnose/stages.hpp"

namespace bolo::diagnose {
namespace {

double filtered(double f_hz, double rate_hz, double alpha, FrameFilter filter) {
  const double c = std::cos(2.0 * std::numbers::pi * f_hz / rate_hz);
  double g = 1.0;
  if (filter == FrameFilter::kRecursive)
    g = alpha * alpha / (1.0 + (1.0 - alpha) * (1.0 - alpha) - 2.0 * (1.0 - alpha) * c);
  if (filter == FrameFilter::kBox) g = alpha * alpha + (1.0 - alpha) * (1.0 - alpha) + 2.0 * alpha * (1.0 - alpha) * c;
  return g;
}

using Spectrum = std::vector<Bin>;

// The exponent of 1/f noise is near 1; outside this range it is another effect.
constexpr double kFlattest = 0.5;
constexpr double kSteepest = 1.7;

// Model of the spectrum: white noise that rises below a corner, a frame filter, and rounding behind the filter.
struct SpectrumFit {
  double rate_hz = 200.0;
  double rounding = 0.0;  // variance of the rounding error
  FrameFilter filter = FrameFilter::kNone;
  double exponent = 1.0;  // of 1/f
  double corner = 0.0;
  double alpha = 1.0;
  double level = 1.0;
  double likelihood = -1e300;
  double rounded = 0.0;  // share of rounding in the level
  double power(const Bin& bin) const {
    const double ratio = corner / bin.frequency;
    const double grown = 1.0 + (exponent == 1.0 ? ratio : std::pow(ratio, exponent));
    return level * ((1.0 - rounded) * grown * filtered(bin.frequency, rate_hz, alpha, filter) + rounded);
  }
};

// Fits the level in closed form, and the share of rounding in it.
SpectrumFit with(const Spectrum& s, const SpectrumFit& as, double corner, double alpha) {
  constexpr double kMostRounded = 0.25;  // above, steps are over twice the noise, and rounding errors are correlated
  SpectrumFit fit{as.rate_hz, as.rounding, as.filter, as.exponent, corner, alpha, 1.0, 0.0};
  for (int round = 0; round < 2; ++round) {
    fit.level *=
        sum_of(s, [&](const Bin& bin) { return bin.weight * bin.power / fit.power(bin); }) / sum_of(s, &Bin::weight);
    const double share = as.rounding / fit.level;
    if (share > 0.0 && share < kMostRounded) fit.rounded = share;
  }
  for (const Bin& bin : s) {
    const double model = fit.power(bin);
    fit.likelihood -= bin.weight * (std::log(model) + bin.power / model);
  }
  return fit;
}

// Searches corner and filter weight, as far as they are wanted.
SpectrumFit fit_spectrum(const Spectrum& s, const SpectrumFit& as, bool with_corner) {
  const bool with_alpha = as.filter != FrameFilter::kNone;
  double corner_step = with_corner ? 2.0 : 0.0;
  double alpha_step = with_alpha ? 0.2 : 0.0;
  SpectrumFit best = with(s, as, 0.0, with_alpha ? 0.75 : 1.0);
  for (int round = 0; round < 60 && (corner_step > 1e-3 || alpha_step > 1e-4); ++round) {
    SpectrumFit next = best;
    for (const double dc : {-corner_step, 0.0, corner_step}) {
      for (const double da : {-alpha_step, 0.0, alpha_step}) {
        const double corner = std::max(0.0, best.corner + dc);
        const double alpha = std::clamp(best.alpha + da, as.filter == FrameFilter::kBox ? 0.5 : 0.05, 1.0);
        const SpectrumFit tried = with(s, best, corner, alpha);
        if (tried.likelihood > next.likelihood) next = tried;
      }
    }
    if (next.likelihood <= best.likelihood) {
      corner_step /= 2.0;
      alpha_step /= 2.0;
    }
    best = next;
  }
  return best;
}

// Fits the exponent, without a filter.
SpectrumFit fit_slope(const Spectrum& s, const SpectrumFit& pink) {
  SpectrumFit best = pink;
  for (double step = 0.2; step > 0.01; step /= 2.0) {
    for (bool better = true; better;) {
      better = false;
      for (const double change : {-step, step}) {
        SpectrumFit as = best;
        as.exponent = std::clamp(best.exponent + change, kFlattest, kSteepest);
        const SpectrumFit tried = fit_spectrum(s, as, true);
        if (tried.likelihood <= best.likelihood) continue;
        best = tried;
        better = true;
      }
    }
  }
  return best;
}

// Standard error of corner or alpha from the curvature of the likelihood.
double curvature_error(const Spectrum& s, const SpectrumFit& fit, bool corner) {
  const double h = corner ? std::max(0.05, 0.02 * fit.corner) : 0.005;
  const double c = corner ? h : 0.0;
  const double a = corner ? 0.0 : h;
  const double low = with(s, fit, std::max(0.0, fit.corner - c), fit.alpha - a).likelihood;
  const double high = with(s, fit, fit.corner + c, std::min(1.0, fit.alpha + a)).likelihood;
  const double bend = (2.0 * fit.likelihood - low - high) / (h * h);
  return bend > 0.0 ? 1.0 / std::sqrt(bend) : 1.0;
}

double student_likelihood(const std::vector<double>& x, double degrees, double scale) {
  const double constant = std::lgamma((degrees + 1.0) / 2.0) - std::lgamma(degrees / 2.0) -
                          0.5 * std::log(degrees * std::numbers::pi) - std::log(scale);
  return sum_of(
      x, [=](double v) { return constant - (degrees + 1.0) / 2.0 * std::log1p(v * v / (degrees * scale * scale)); });
}

// Sessions without effects stay below all of these limits.
constexpr double kLeastComponent = 0.0015;   // K, for flicker and stripes
constexpr double kClear = 8.0;               // standard errors
constexpr double kLeastCorner = 0.08;        // Hz
constexpr double kLeastKurtosis = 0.25;      // above a Gaussian's
constexpr double kClearLine = 1e-6;          // p-value
constexpr double kClearMisfit = 7.0;         // standard errors of a band of the spectrum
constexpr double kLeastScale = 1.04;         // relative to the nominal noise
constexpr double kLeastScaleOfTails = 1.12;  // the same with heavy tails
constexpr double kScaleError = 0.004;        // relative error of the level

bool shows(const Measured& component) { return component.z > kClear && component.value > kLeastComponent; }

// Nominal noise of one value, K rms; the measured one if not radiometric.
double nominal_noise(const Session& session, const NoiseStatistics& statistics, const model::CameraProfile& p) {
  if (!session.recordings.front().kelvin) return statistics.white_k;
  return std::sqrt(p.noise_k * p.noise_k + p.quantisation_k * p.quantisation_k / 12.0);
}

double floor_of(const Events& events, const Noise& noise, const model::CameraProfile& p) {
  const NoiseStatistics& s = noise.statistics;
  const double floor_k = s.frames > 0 && s.total_k > 0.0 ? s.total_k : noise.nominal_k;
  if (!events.coarse || p.quantisation_k <= 0.0) return floor_k;
  // A still field lies at one point between two steps; a moving scene covers the whole step.
  return std::max(floor_k, std::sqrt(p.noise_k * p.noise_k + events.step_k * events.step_k / 12.0));
}

void name_components(const NoiseStatistics& n, Findings& out) {
  if (shows(n.flicker)) {
    out.add("flicker", n.flicker.z, "whole frames differ by an offset", {{"sigma_k", n.flicker.estimate()}});
  }
  if (shows(n.rows) || shows(n.columns)) {
    out.add("stripes", std::max(n.rows.z, n.columns.z), "rows or columns differ by an offset in every frame",
            {{"column_k", n.columns.estimate()}, {"row_k", n.rows.estimate()}});
  }
}

void name_spectrum_and_tails(const Noise& noise, bool coarse, const model::CameraProfile& p, Findings& out) {
  const NoiseStatistics& n = noise.statistics;
  if (n.filter != FrameFilter::kNone) {
    out.add("iir", n.alpha.z, "the noise is correlated from frame to frame", {{"alpha", n.alpha.estimate()}});
  }
  // Rounding of filtered noise to coarse steps is slow, too.
  const bool hops = coarse && n.filter != FrameFilter::kNone;
  if (n.corner_hz.z > kClearCorner && n.corner_hz.value > kLeastCorner && !hops) {
    out.add("one_over_f", n.corner_hz.z, "the noise grows towards low frequencies",
            {{"corner_hz", n.corner_hz.estimate()}});
  }
  const bool tails = n.excess_kurtosis.z > kClear && n.excess_kurtosis.value > kLeastKurtosis && !coarse;
  if (tails) {
    out.add("heavy_tail", n.excess_kurtosis.z, "the noise has outliers",
            {{"degrees", interval(n.degrees, n.degrees_error)}});
  }
  const double scale = n.white_k / noise.nominal_k;
  if (scale > (tails ? kLeastScaleOfTails : kLeastScale) && !coarse) {
    const double error = kScaleError * scale;
    const double quantisation2 = p.quantisation_k * p.quantisation_k / 12.0;
    const double own = std::sqrt(std::max(0.0, n.white_k * n.white_k - quantisation2)) / p.noise_k;
    out.add("noise_level", (scale - 1.0) / error, "the noise is stronger than the profile says",
            {{"scale", interval(own, error)}});
  }
}

// Number of codes that never occur although the adjacent ones often do. `step_k`: between values.
std::size_t missing_codes(const Session& session, double step_k) {
  constexpr std::size_t kOften = 200;
  std::vector<std::size_t> seen(1U << 16U, 0);
  const double middle = session.recordings.front().values(0, 0);
  for (const Recording& r : session.recordings) {
    for (Index k = 0; k < r.values.rows(); k += 3) {
      for (Index p = 0; p < r.values.cols(); p += 3) {
        const long code = std::lround((r.values(k, p) - middle) / step_k) + (1L << 15U);
        if (session.is_good(p) && code >= 0 && code < std::ssize(seen)) ++seen[static_cast<std::size_t>(code)];
      }
    }
  }
  std::size_t missing = 0;
  for (std::size_t c = 1; c + 1 < seen.size(); ++c) {
    missing += seen[c] == 0 && std::min(seen[c - 1], seen[c + 1]) > kOften ? 1U : 0U;
  }
  return missing;
}

// Signs of effects outside the catalogue.
void name_rest(const NoiseStatistics& n, bool coarse, Findings& out) {
  if (n.line_p < kClearLine) {
    out.remainders.push_back({"readout",
                              "a line at " + std::to_string(static_cast<int>(std::lround(n.line_hz))) +
                                  " Hz in the means of frames or of their halves",
                              kClear});
  }
  // Correlated noise of neighbours, without flicker and stripes.
  for (const auto& [line, z] : {std::pair{"row", n.neighbour_row_z}, {"column", n.neighbour_column_z}}) {
    const std::string where = std::string("the noise of a pixel shows in its neighbour in the ") + line;
    if (std::abs(z) > kClear) out.remainders.push_back({"readout", where, std::abs(z)});
  }
  if (n.spectrum_misfit > kClearMisfit && !coarse) {
    out.remainders.push_back({"noise", "the noise's spectrum has a shape that no effect gives it", n.spectrum_misfit});
  }
}

}  // namespace

std::vector<double> periodogram(const ArrayXd& x) {
  const auto n = static_cast<double>(x.size());
  std::vector<double> windowed;
  double norm = 0.0;
  for (Index k = 0; k < x.size(); ++k) {
    const double w = 0.5 - 0.5 * std::cos(2.0 * std::numbers::pi * (static_cast<double>(k) + 0.5) / n);
    windowed.push_back(w * x[k]);
    norm += w * w;
  }
  Eigen::FFT<double> fft;
  fft.SetFlag(Eigen::FFT<double>::HalfSpectrum);
  std::vector<std::complex<double>> spectrum;
  fft.fwd(spectrum, windowed);
  return mapped(spectrum, [norm](const std::complex<double>& s) { return std::norm(s) / norm; });
}

void judge_spectrum(const Spectrum& s, double rate_hz, double rounding, NoiseStatistics& n) {
  constexpr double kGain = 15.0;          // minimum log-likelihood gain of a corner or a filter
  constexpr double kOtherGain = 3.0;      // between kinds of filter
  constexpr double kLeastFilter = 0.985;  // a weight nearer to 1 counts as no filter
  SpectrumFit as{rate_hz, rounding};
  const SpectrumFit pink = fit_spectrum(s, as, true);
  SpectrumFit best = pink;
  for (const FrameFilter tried : {FrameFilter::kRecursive, FrameFilter::kBox}) {
    as.filter = tried;
    const SpectrumFit both = fit_spectrum(s, as, true);
    if (both.likelihood > best.likelihood + (best.filter == FrameFilter::kNone ? kGain : kOtherGain) &&
        both.alpha < kLeastFilter) {
      best = both;
    }
  }
  // 1/f noise with another exponent looks like 1/f noise with a filter.
  if (pink.likelihood > fit_spectrum(s, {rate_hz, rounding}, false).likelihood + kGain) {
    const SpectrumFit sloped = fit_slope(s, pink);
    if (sloped.likelihood > best.likelihood + (best.filter == FrameFilter::kNone ? kGain : 0.0)) best = sloped;
  }
  const SpectrumFit without_corner = fit_spectrum(s, {rate_hz, rounding, best.filter}, false);
  const double corner_gain = best.likelihood - without_corner.likelihood;
  if (corner_gain < kGain) best = without_corner;
  n.filter = best.filter;
  n.white_k = std::sqrt(best.level);
  n.corner_hz = {best.corner, curvature_error(s, best, true), corner_gain < kGain ? 0.0 : std::sqrt(2.0 * corner_gain)};
  n.alpha = {best.filter == FrameFilter::kNone ? 1.0 : best.alpha, 0.0, 0.0};
  if (best.filter != FrameFilter::kNone) {
    n.alpha.error = curvature_error(s, best, false);
    n.alpha.z = std::sqrt(2.0 * std::max(0.0, best.likelihood - pink.likelihood));
  }
  constexpr std::size_t kBands = 12;
  for (std::size_t b = 0; b < kBands; ++b) {
    const std::size_t first = b * s.size() / kBands;
    const auto band = std::span(s).subspan(first, (b + 1) * s.size() / kBands - first);
    const double sum = sum_of(band, [&](const Bin& bin) { return bin.weight * (bin.power / best.power(bin) - 1.0); });
    const double weights = sum_of(band, &Bin::weight);
    if (weights > 0.0) n.spectrum_misfit = std::max(n.spectrum_misfit, std::abs(sum) / std::sqrt(weights));
  }
}

void fit_student(const std::vector<double>& x, NoiseStatistics& n) {
  double best = -1e300;
  const auto at = [&](double degrees) {
    // The sample variance depends on the tails, so the scale is fitted by likelihood, too (golden section).
    double low = 0.4 * n.sigma_tvh;
    double high = 1.15 * n.sigma_tvh;
    for (int i = 0; i < 14; ++i) {
      const double a = high - 0.618 * (high - low);
      const double b = low + 0.618 * (high - low);
      if (student_likelihood(x, degrees, a) > student_likelihood(x, degrees, b)) {
        high = b;
      } else {
        low = a;
      }
    }
    return student_likelihood(x, degrees, (low + high) / 2.0);
  };
  std::vector<std::pair<double, double>> tried;
  for (double degrees = 2.2; degrees < 30.0; degrees *= 1.05) {
    const double value = at(degrees);
    tried.emplace_back(degrees, value);
    if (value > best) {
      best = value;
      n.degrees = degrees;
    }
  }
  std::erase_if(tried, [best](const auto& one) { return !(one.second > best - 0.5); });
  if (tried.empty()) return;
  n.degrees_error = std::max((tried.back().first - tried.front().first) / 2.0, 0.03 * n.degrees);
}

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
  name_components(noise.statistics, noise.findings);
  name_spectrum_and_tails(noise, events.coarse, options.profile, noise.findings);
  for (Finding& one : noise.findings.effects) one.effect.of_noise = true;
  name_rest(noise.statistics, events.coarse, noise.findings);
  // Noise below one step leaves codes out by itself.
  if (events.step_k > 0.0 && noise.floor_k > events.step_k && missing_codes(events.session, events.step_k) > 0) {
    noise.findings.remainders.push_back({"readout", "single values never come, unlike those on either side", kClear});
  }
  return noise;
}

}  // namespace bolo::diagnose

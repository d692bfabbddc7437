// Fits by likelihood: the spectrum of the pixels' noise, and the tails of its distribution.
#include <algorithm>
#include <cmath>
#include <complex>
#include <numbers>
#include <utility>

#include <unsupported/Eigen/FFT>

#include "src/diagnose/noise.hpp"

namespace bolo::diagnose {
namespace {

double shape(double f_hz, double rate_hz, double corner_hz, double alpha, FrameFilter filter) {
  const double c = std::cos(2.0 * std::numbers::pi * f_hz / rate_hz);
  double g = 1.0;
  if (filter == FrameFilter::kRecursive)
    g = alpha * alpha / (1.0 + (1.0 - alpha) * (1.0 - alpha) - 2.0 * (1.0 - alpha) * c);
  if (filter == FrameFilter::kBox) g = alpha * alpha + (1.0 - alpha) * (1.0 - alpha) + 2.0 * alpha * (1.0 - alpha) * c;
  return (1.0 + corner_hz / f_hz) * g;
}

using Spectrum = std::vector<Bin>;

// A model of the spectrum: white noise, a corner, a filter.
struct SpectrumFit {
  double rate_hz = 200.0;
  FrameFilter filter = FrameFilter::kNone;
  double corner = 0.0;
  double alpha = 1.0;
  double level = 1.0;
  double likelihood = -1e300;
  double power(const Bin& bin) const { return level * shape(bin.frequency, rate_hz, corner, alpha, filter); }
};

// The level by its closed form.
SpectrumFit with(const Spectrum& s, const SpectrumFit& as, double corner, double alpha) {
  SpectrumFit fit{as.rate_hz, as.filter, corner, alpha, 1.0, 0.0};
  double level = 0.0;
  double weights = 0.0;
  for (const Bin& bin : s) {
    level += bin.weight * bin.power / fit.power(bin);
    weights += bin.weight;
  }
  fit.level = level / weights;
  for (const Bin& bin : s) {
    const double model = fit.power(bin);
    fit.likelihood -= bin.weight * (std::log(model) + bin.power / model);
  }
  return fit;
}

// The others by search.
SpectrumFit fit_spectrum(const Spectrum& s, double rate_hz, bool with_corner, FrameFilter filter) {
  const bool with_alpha = filter != FrameFilter::kNone;
  double corner_step = with_corner ? 2.0 : 0.0;
  double alpha_step = with_alpha ? 0.2 : 0.0;
  SpectrumFit best = with(s, {rate_hz, filter}, 0.0, with_alpha ? 0.75 : 1.0);
  for (int round = 0; round < 60 && (corner_step > 1e-3 || alpha_step > 1e-4); ++round) {
    SpectrumFit next = best;
    for (const double dc : {-corner_step, 0.0, corner_step}) {
      for (const double da : {-alpha_step, 0.0, alpha_step}) {
        const double corner = std::max(0.0, best.corner + dc);
        const double alpha = std::clamp(best.alpha + da, filter == FrameFilter::kBox ? 0.5 : 0.05, 1.0);
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

// Standard error of one number of the fit from the curvature of the likelihood.
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
  double sum = 0.0;
  for (const double v : x) sum += constant - (degrees + 1.0) / 2.0 * std::log1p(v * v / (degrees * scale * scale));
  return sum;
}

}  // namespace

std::vector<double> periodogram(const Eigen::ArrayXd& x) {
  const Eigen::Index n = x.size();
  std::vector<double> windowed(static_cast<std::size_t>(n));
  double norm = 0.0;
  for (Eigen::Index k = 0; k < n; ++k) {
    const double w =
        0.5 - 0.5 * std::cos(2.0 * std::numbers::pi * (static_cast<double>(k) + 0.5) / static_cast<double>(n));
    windowed[static_cast<std::size_t>(k)] = w * x[k];
    norm += w * w;
  }
  Eigen::FFT<double> fft;
  fft.SetFlag(Eigen::FFT<double>::HalfSpectrum);
  std::vector<std::complex<double>> spectrum;
  fft.fwd(spectrum, windowed);
  std::vector<double> power;
  power.reserve(spectrum.size());
  for (const auto& s : spectrum) power.push_back(std::norm(s) / norm);
  return power;
}

void judge_spectrum(const Spectrum& s, double rate_hz, NoiseStatistics& n) {
  constexpr double kGain = 15.0;          // of log-likelihood, that a corner or a filter must bring
  constexpr double kOtherGain = 3.0;      // that one kind of filter must bring over the other
  constexpr double kLeastFilter = 0.985;  // a weight nearer to 1 is no filter
  const SpectrumFit pink = fit_spectrum(s, rate_hz, true, FrameFilter::kNone);
  SpectrumFit best = pink;
  for (const FrameFilter tried : {FrameFilter::kRecursive, FrameFilter::kBox}) {
    const SpectrumFit both = fit_spectrum(s, rate_hz, true, tried);
    if (both.likelihood > best.likelihood + (best.filter == FrameFilter::kNone ? kGain : kOtherGain) &&
        both.alpha < kLeastFilter) {
      best = both;
    }
  }
  const SpectrumFit without_corner = fit_spectrum(s, rate_hz, false, best.filter);
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
  // Does any band stand out?
  constexpr std::size_t kBands = 12;
  for (std::size_t b = 0; b < kBands; ++b) {
    double sum = 0.0;
    double weights = 0.0;
    for (std::size_t j = b * s.size() / kBands; j < (b + 1) * s.size() / kBands; ++j) {
      sum += s[j].weight * (s[j].power / best.power(s[j]) - 1.0);
      weights += s[j].weight;
    }
    if (weights > 0.0) n.spectrum_misfit = std::max(n.spectrum_misfit, std::abs(sum) / std::sqrt(weights));
  }
}

void fit_student(const std::vector<double>& x, NoiseStatistics& n) {
  double best = -1e300;
  const auto at = [&](double degrees) {
    // The scale that the variance asks for would trust the tails; the likelihood chooses it too (golden section).
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
  double low = n.degrees;
  double high = n.degrees;
  for (const auto& [degrees, value] : tried) {
    if (value > best - 0.5) {
      low = std::min(low, degrees);
      high = std::max(high, degrees);
    }
  }
  n.degrees_error = std::max((high - low) / 2.0, 0.03 * n.degrees);
}

}  // namespace bolo::diagnose

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

struct SpectrumFit {
  double likelihood = -1e300;
  double level = 0.0;
  double corner = 0.0;
  double alpha = 1.0;
};

// The level by its closed form, the others by search.
SpectrumFit likelihood_of(const Spectrum& s, double corner, double alpha, FrameFilter filter) {
  double level = 0.0;
  double weights = 0.0;
  for (std::size_t j = 0; j < s.power.size(); ++j) {
    level += s.weight[j] * s.power[j] / shape(s.frequency[j], s.rate_hz, corner, alpha, filter);
    weights += s.weight[j];
  }
  level /= weights;
  double sum = 0.0;
  for (std::size_t j = 0; j < s.power.size(); ++j) {
    const double model = level * shape(s.frequency[j], s.rate_hz, corner, alpha, filter);
    sum -= s.weight[j] * (std::log(model) + s.power[j] / model);
  }
  return {sum, level, corner, alpha};
}

SpectrumFit fit_spectrum(const Spectrum& s, bool with_corner, FrameFilter filter) {
  SpectrumFit best = likelihood_of(s, 0.0, 1.0, filter);
  const bool with_alpha = filter != FrameFilter::kNone;
  double corner_step = with_corner ? 2.0 : 0.0;
  double alpha_step = with_alpha ? 0.2 : 0.0;
  if (with_alpha) best = likelihood_of(s, 0.0, 0.75, filter);
  for (int round = 0; round < 60 && (corner_step > 1e-3 || alpha_step > 1e-4); ++round) {
    SpectrumFit next = best;
    for (const double dc : {-corner_step, 0.0, corner_step}) {
      for (const double da : {-alpha_step, 0.0, alpha_step}) {
        const double corner = std::max(0.0, best.corner + dc);
        const double alpha = std::clamp(best.alpha + da, filter == FrameFilter::kBox ? 0.5 : 0.05, 1.0);
        const SpectrumFit tried = likelihood_of(s, corner, alpha, filter);
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
double curvature_error(const Spectrum& s, const SpectrumFit& fit, FrameFilter filter, bool corner) {
  const double h = corner ? std::max(0.05, 0.02 * fit.corner) : 0.005;
  const double c = corner ? h : 0.0;
  const double a = corner ? 0.0 : h;
  const double low = likelihood_of(s, std::max(0.0, fit.corner - c), fit.alpha - a, filter).likelihood;
  const double high = likelihood_of(s, fit.corner + c, std::min(1.0, fit.alpha + a), filter).likelihood;
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

void judge_spectrum(const Spectrum& s, NoiseStatistics& n) {
  constexpr double kGain = 15.0;          // of log-likelihood, that a corner or a filter must bring
  constexpr double kOtherGain = 3.0;      // that one kind of filter must bring over the other
  constexpr double kLeastFilter = 0.985;  // a weight nearer to 1 is no filter
  const SpectrumFit white = fit_spectrum(s, false, FrameFilter::kNone);
  const SpectrumFit pink = fit_spectrum(s, true, FrameFilter::kNone);
  SpectrumFit best = pink;
  FrameFilter filter = FrameFilter::kNone;
  for (const FrameFilter tried : {FrameFilter::kRecursive, FrameFilter::kBox}) {
    const SpectrumFit both = fit_spectrum(s, true, tried);
    if (both.likelihood > best.likelihood + (filter == FrameFilter::kNone ? kGain : kOtherGain) &&
        both.alpha < kLeastFilter) {
      best = both;
      filter = tried;
    }
  }
  const SpectrumFit without_corner = filter == FrameFilter::kNone ? white : fit_spectrum(s, false, filter);
  const double corner_gain = best.likelihood - without_corner.likelihood;
  if (corner_gain < kGain) best = without_corner;
  n.filter = filter;
  n.white_k = std::sqrt(best.level);
  n.corner_hz = {best.corner, curvature_error(s, best, filter, true),
                 corner_gain < kGain ? 0.0 : std::sqrt(2.0 * corner_gain)};
  n.alpha = {filter == FrameFilter::kNone ? 1.0 : best.alpha, 0.0, 0.0};
  if (filter != FrameFilter::kNone) {
    n.alpha.error = curvature_error(s, best, filter, false);
    n.alpha.z = std::sqrt(2.0 * std::max(0.0, best.likelihood - pink.likelihood));
  }
  // Twelve bands: does any of them stand out?
  const std::size_t bands = 12;
  for (std::size_t b = 0; b < bands; ++b) {
    double sum = 0.0;
    double weights = 0.0;
    for (std::size_t j = b * s.power.size() / bands; j < (b + 1) * s.power.size() / bands; ++j) {
      const double model = best.level * shape(s.frequency[j], s.rate_hz, best.corner, best.alpha, filter);
      sum += s.weight[j] * (s.power[j] / model - 1.0);
      weights += s.weight[j];
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

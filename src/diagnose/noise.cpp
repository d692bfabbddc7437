#include "noise.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <complex>
#include <numbers>
#include <numeric>

#include <Eigen/Dense>
#include <unsupported/Eigen/FFT>

namespace bolo::diagnose {
namespace {

using Eigen::ArrayXd;
using Eigen::ArrayXXd;
using Eigen::Index;

double median(std::vector<double> values) {
  if (values.empty()) return 0.0;
  const auto middle = values.begin() + static_cast<long>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

// The longest run of frames without a gap, and the good pixels' places in the grid.
struct Block {
  std::size_t recording = 0;
  double start_s = 0.0;
  ArrayXXd value;  // frames x grid pixels, pixel means taken out; bad pixels 0
};

std::optional<Block> longest_block(const Session& session, std::size_t index) {
  const Recording& r = session.recordings[index];
  Index best_from = 0;
  Index best_length = 0;
  for (Index k = 0; k < r.values.rows();) {
    if (r.used[static_cast<std::size_t>(k)] == 0) {
      ++k;
      continue;
    }
    const Index from = k;
    while (k < r.values.rows() && r.used[static_cast<std::size_t>(k)] != 0) ++k;
    if (k - from > best_length) {
      best_length = k - from;
      best_from = from;
    }
  }
  if (best_length < 24) return std::nullopt;
  Block block{index, r.t[static_cast<std::size_t>(best_from)],
              r.values.middleRows(best_from, best_length).cast<double>().array()};
  for (Index p = 0; p < block.value.cols(); ++p) {
    if (session.good[static_cast<std::size_t>(p)] == 0) {
      block.value.col(p).setZero();
    } else {
      block.value.col(p) -= block.value.col(p).mean();
    }
  }
  return block;
}

// What belongs to frames, rows and columns, and what is left to the pixels.
struct Parts {
  ArrayXd frame;    // mean of each frame
  ArrayXXd row;     // frames x rows, about the frame
  ArrayXXd column;  // frames x columns
  ArrayXXd rest;    // frames x pixels
};

Parts take_apart(const Session& session, const Block& block) {
  const auto width = static_cast<Index>(session.grid.columns.size());
  const auto height = static_cast<Index>(session.grid.rows.size());
  const Index frames = block.value.rows();
  Parts parts{ArrayXd::Zero(frames), ArrayXXd::Zero(frames, height), ArrayXXd::Zero(frames, width), block.value};
  ArrayXd in_row = ArrayXd::Zero(height);
  ArrayXd in_column = ArrayXd::Zero(width);
  double count = 0.0;
  for (Index p = 0; p < block.value.cols(); ++p) {
    if (session.good[static_cast<std::size_t>(p)] == 0) continue;
    parts.frame += block.value.col(p);
    in_row[p / width] += 1.0;
    in_column[p % width] += 1.0;
    count += 1.0;
  }
  parts.frame /= std::max(1.0, count);
  for (Index p = 0; p < block.value.cols(); ++p) {
    if (session.good[static_cast<std::size_t>(p)] == 0) continue;
    const ArrayXd about = block.value.col(p) - parts.frame;
    parts.row.col(p / width) += about / in_row[p / width];
    parts.column.col(p % width) += about / in_column[p % width];
  }
  for (Index p = 0; p < block.value.cols(); ++p) {
    if (session.good[static_cast<std::size_t>(p)] == 0) continue;
    parts.rest.col(p) -= parts.frame + parts.row.col(p / width) + parts.column.col(p % width);
  }
  return parts;
}

// A cubic in time, and what is left.
ArrayXd without_cubic(const ArrayXd& x, ArrayXd* fitted = nullptr) {
  const Index n = x.size();
  Eigen::MatrixXd basis(n, 4);
  for (Index k = 0; k < n; ++k) {
    const double s = 2.0 * static_cast<double>(k) / static_cast<double>(std::max<Index>(1, n - 1)) - 1.0;
    basis.row(k) << 1.0, s, s * s, s * s * s;
  }
  const Eigen::VectorXd solved = basis.colPivHouseholderQr().solve(x.matrix());
  const ArrayXd curve = (basis * solved).array();
  if (fitted != nullptr) *fitted = curve;
  return x - curve;
}

std::vector<double> periodogram(const ArrayXd& x) {
  const Index n = x.size();
  std::vector<double> windowed(static_cast<std::size_t>(n));
  double norm = 0.0;
  for (Index k = 0; k < n; ++k) {
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
  return power;  // white noise: its variance in every bin
}

// Survival function of chi-square with an even or odd number of degrees, by Wilson and Hilferty.
double chi2_survival(double x, double degrees) {
  if (degrees <= 0.0) return 1.0;
  const double z = (std::cbrt(x / degrees) - (1.0 - 2.0 / (9.0 * degrees))) / std::sqrt(2.0 / (9.0 * degrees));
  return 0.5 * std::erfc(z / std::numbers::sqrt2);
}

struct Spectrum {
  double rate_hz = 200.0;
  std::vector<double> frequency;  // Hz
  std::vector<double> power;      // mean over pixels
  std::vector<double> weight;     // half the degrees of freedom
};

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

void judge_spectrum(const Spectrum& s, NoiseStatistics& n) {
  constexpr double kGain = 15.0;
  const SpectrumFit white = fit_spectrum(s, false, FrameFilter::kNone);
  const SpectrumFit pink = fit_spectrum(s, true, FrameFilter::kNone);
  SpectrumFit best = pink;
  FrameFilter filter = FrameFilter::kNone;
  for (const FrameFilter tried : {FrameFilter::kRecursive, FrameFilter::kBox}) {
    const SpectrumFit both = fit_spectrum(s, true, tried);
    if (both.likelihood > best.likelihood + (filter == FrameFilter::kNone ? kGain : 3.0) && both.alpha < 0.985) {
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

double student_likelihood(const std::vector<double>& x, double degrees, double scale) {
  const double constant = std::lgamma((degrees + 1.0) / 2.0) - std::lgamma(degrees / 2.0) -
                          0.5 * std::log(degrees * std::numbers::pi) - std::log(scale);
  double sum = 0.0;
  for (const double v : x) sum += constant - (degrees + 1.0) / 2.0 * std::log1p(v * v / (degrees * scale * scale));
  return sum;
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
      (student_likelihood(x, degrees, a) > student_likelihood(x, degrees, b) ? high : low) =
          student_likelihood(x, degrees, a) > student_likelihood(x, degrees, b) ? b : a;
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

struct Sums {
  double square = 0.0;
  double count = 0.0;
};

// Variance of a component and its error, the pixels' own noise taken out.
Measured component(double square, double count, double own, double scale) {
  const double raw = square / std::max(1.0, count);
  const double error2 = raw * std::sqrt(2.0 / std::max(1.0, count));
  const double variance = (raw - own) * scale;
  Measured m;
  m.value = std::sqrt(std::max(0.0, variance));
  m.z = (raw - own) / std::max(1e-18, own * std::sqrt(2.0 / std::max(1.0, count)));
  m.error = m.value > 0.0 ? error2 * scale / (2.0 * m.value) : 0.0;
  return m;
}

struct Lines {
  double best_p = 1.0;
  double hz = 0.0;
  double amplitude_k = 0.0;
};

// A bin that stands out of its neighbourhood.
void look_for_lines(const ArrayXd& x, double rate_hz, Lines& lines) {
  const std::vector<double> power = periodogram(without_cubic(x));
  const auto n = static_cast<double>(x.size());
  for (std::size_t j = 4; j + 2 < power.size(); ++j) {
    std::vector<double> around;
    for (std::size_t i = j > 18 ? j - 18 : 2; i < std::min(power.size(), j + 19); ++i) {
      if (i + 2 < j || i > j + 2) around.push_back(power[i]);
    }
    const double floor = median(around) / 0.6931;
    const double p =
        std::min(1.0, static_cast<double>(power.size()) * std::exp(-power[j] / std::max(1e-18, floor) * 0.9));
    if (p >= lines.best_p) continue;
    lines = {p, static_cast<double>(j) * rate_hz / n, std::sqrt(4.0 * power[j] / n * 1.5)};
  }
}

}  // namespace

bool is_still(const Session& session, const Recording& r) {
  // A pixel that sees motion varies more over the whole recording than between two frames.
  std::vector<double> ratio;
  for (Index p = 0; p < r.values.cols(); ++p) {
    if (session.good[static_cast<std::size_t>(p)] == 0) continue;
    const ArrayXd x = r.values.col(p).cast<double>().array();
    const double variance = (x - x.mean()).square().mean();
    const double step = (x.tail(x.size() - 1) - x.head(x.size() - 1)).square().mean() / 2.0;
    ratio.push_back(variance / std::max(1e-12, step));
  }
  return median(ratio) < 3.0;
}

NoiseStatistics measure_noise(const Session& session, double ceiling) {
  NoiseStatistics n;
  std::vector<Block> blocks;
  for (int pass = 0; pass < 2 && blocks.empty(); ++pass) {
    for (std::size_t i = 0; i < session.recordings.size(); ++i) {
      const Recording& r = session.recordings[i];
      const bool wanted = pass == 0 ? r.kind == Kind::kUniform : r.kind == Kind::kField && is_still(session, r);
      const auto clipped = (r.values.array() >= static_cast<float>(ceiling)).count();
      if (!wanted || clipped * 500 > r.values.size()) continue;
      if (auto block = longest_block(session, i)) blocks.push_back(std::move(*block));
    }
  }
  if (blocks.empty()) return n;
  const auto width = static_cast<Index>(session.grid.columns.size());
  const auto height = static_cast<Index>(session.grid.rows.size());
  double good = 0.0;
  for (const char g : session.good) good += g != 0 ? 1.0 : 0.0;
  const double share = good / static_cast<double>(session.good.size());
  Sums rest;
  Sums total;
  Sums frame;
  Sums row;
  Sums column;
  Sums left;
  Sums above;
  double lag = 0.0;
  double chi2 = 0.0;
  double degrees = 0.0;
  std::vector<double> kurtosis;
  std::vector<double> sample;
  std::vector<Spectrum> spectra;
  Lines lines;
  for (const Block& block : blocks) {
    const Parts parts = take_apart(session, block);
    const Index frames = block.value.rows();
    n.frames += static_cast<std::size_t>(frames);
    const double freedom = static_cast<double>(frames - 1) / static_cast<double>(frames);
    ArrayXd curve;
    const ArrayXd flicker = without_cubic(parts.frame, &curve);
    frame.square += flicker.square().sum();
    frame.count += static_cast<double>(frames - 4);
    lag += (flicker.tail(frames - 1) * flicker.head(frames - 1)).sum();
    row.square += parts.row.square().sum() / freedom;
    row.count += static_cast<double>(frames) * static_cast<double>(height);
    column.square += parts.column.square().sum() / freedom;
    column.count += static_cast<double>(frames) * static_cast<double>(width);
    const double pixel_freedom =
        freedom * (1.0 - 1.0 / static_cast<double>(width)) * (1.0 - 1.0 / static_cast<double>(height));
    Spectrum spectrum;
    spectrum.rate_hz = 1.0 / session.period_s;
    std::vector<double> power;
    double pixels = 0.0;
    for (Index p = 0; p < block.value.cols(); ++p) {
      if (session.good[static_cast<std::size_t>(p)] == 0) continue;
      const ArrayXd& x = parts.rest.col(p);
      const double square = x.square().sum();
      rest.square += square / pixel_freedom;
      rest.count += static_cast<double>(frames);
      const ArrayXd about = block.value.col(p) - curve;
      total.square += about.square().sum() / freedom;
      total.count += static_cast<double>(frames);
      const double m2 = square / static_cast<double>(frames);
      kurtosis.push_back(x.square().square().mean() / std::max(1e-18, m2 * m2) - 3.0);
      const std::vector<double> one = periodogram(x);
      power.resize(one.size(), 0.0);
      for (std::size_t j = 0; j < one.size(); ++j) power[j] += one[j] / pixel_freedom;
      pixels += 1.0;
      if (p % width > 0 && session.grid.columns[static_cast<std::size_t>(p % width)] -
                                   session.grid.columns[static_cast<std::size_t>(p % width - 1)] ==
                               1) {
        left.square += (x * parts.rest.col(p - 1)).sum();
        left.count += static_cast<double>(frames);
      }
      if (p >= width && session.grid.rows[static_cast<std::size_t>(p / width)] -
                                session.grid.rows[static_cast<std::size_t>(p / width - 1)] ==
                            1) {
        above.square += (x * parts.rest.col(p - width)).sum();
        above.count += static_cast<double>(frames);
      }
      for (Index k = p % 7; k < frames; k += 7) {
        if (sample.size() < 30000) sample.push_back(x[k]);
      }
    }
    for (std::size_t j = 3; j + 1 < power.size(); ++j) {
      spectrum.frequency.push_back(static_cast<double>(j) * spectrum.rate_hz / static_cast<double>(frames));
      spectrum.power.push_back(power[j] / pixels);
      spectrum.weight.push_back(pixels / 1.5);  // Hann's window binds neighbouring bins together
    }
    spectra.push_back(std::move(spectrum));
    // Slow change: what the cubic takes, against the flicker that is left (with its own correlation).
    const double own = std::max(1e-18, flicker.square().sum() / static_cast<double>(frames - 4));
    const double bound =
        std::clamp((flicker.tail(frames - 1) * flicker.head(frames - 1)).sum() / flicker.square().sum(), 0.0, 0.98);
    chi2 += curve.square().sum() / own * (1.0 - bound) / (1.0 + bound);
    degrees += 3.0;
    n.drift_k = std::max(n.drift_k, curve.maxCoeff() - curve.minCoeff());
    ArrayXd halves = ArrayXd::Zero(frames);
    for (Index r = 0; r < height; ++r)
      halves += parts.row.col(r) * (r < height / 2 ? 1.0 : -1.0) / static_cast<double>(height);
    look_for_lines(halves, 1.0 / session.period_s, lines);
    look_for_lines(parts.frame, 1.0 / session.period_s, lines);
  }
  const double own = rest.square / rest.count;
  n.sigma_tvh = std::sqrt(own);
  n.total_k = std::sqrt(total.square / total.count);
  n.flicker_correlation = frame.square > 0.0 ? lag / frame.square : 0.0;
  const double in_row = static_cast<double>(width) * share;
  const double in_column = static_cast<double>(height) * share;
  n.rows = component(row.square, row.count * (1.0 - 1.0 / static_cast<double>(height)), own / in_row, 1.0);
  n.columns = component(column.square, column.count * (1.0 - 1.0 / static_cast<double>(width)), own / in_column, 1.0);
  const double stripes = n.columns.value * n.columns.value / static_cast<double>(width) +
                         n.rows.value * n.rows.value / static_cast<double>(height);
  n.flicker = component(frame.square, frame.count, own / good + stripes, 1.0);
  // Taking out the means of rows and columns binds neighbours by - 1/width or - 1/height.
  const auto correlation_z = [&](const Sums& s, double bias) {
    return s.count > 0.0 ? (s.square / s.count / own + bias) * std::sqrt(s.count) : 0.0;
  };
  n.neighbour_row_z = correlation_z(left, 1.0 / in_row);
  n.neighbour_column_z = correlation_z(above, 1.0 / in_column);
  Spectrum all;
  all.rate_hz = 1.0 / session.period_s;
  for (const Spectrum& s : spectra) {
    all.frequency.insert(all.frequency.end(), s.frequency.begin(), s.frequency.end());
    all.power.insert(all.power.end(), s.power.begin(), s.power.end());
    all.weight.insert(all.weight.end(), s.weight.begin(), s.weight.end());
  }
  // In order of frequency, so that bands mean something.
  std::vector<std::size_t> order(all.frequency.size());
  std::iota(order.begin(), order.end(), 0U);
  std::ranges::sort(order, {}, [&](std::size_t j) { return all.frequency[j]; });
  Spectrum sorted;
  sorted.rate_hz = all.rate_hz;
  for (const std::size_t j : order) {
    sorted.frequency.push_back(all.frequency[j]);
    sorted.power.push_back(all.power[j]);
    sorted.weight.push_back(all.weight[j]);
  }
  judge_spectrum(sorted, n);
  const double typical = median(kurtosis);
  const double frames_each = static_cast<double>(n.frames) / static_cast<double>(blocks.size());
  // The kurtosis of a sample of n is low by about 6/n in the mean and more in the median.
  n.excess_kurtosis = {typical + 12.0 / frames_each,
                       1.25 * std::sqrt(24.0 / frames_each / static_cast<double>(kurtosis.size())), 0.0};
  n.excess_kurtosis.z = n.excess_kurtosis.value / n.excess_kurtosis.error;
  if (n.excess_kurtosis.value > 0.2) fit_student(sample, n);
  n.line_hz = lines.hz;
  n.line_k = lines.amplitude_k;
  n.line_p = lines.best_p;
  n.drift_p = chi2_survival(chi2, degrees);
  return n;
}

}  // namespace bolo::diagnose

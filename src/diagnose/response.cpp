#include "src/diagnose/model.hpp"

#include <unsupported/Eigen/FFT>

namespace bolo::diagnose {
namespace {

constexpr int kTableShares = 512;  // entries for the covered share of a pixel
constexpr double kTwoPi = 2.0 * std::numbers::pi;

using Complex = std::complex<double>;

Complex thermal(const Response& r, double omega, double lateral) {
  const Complex i(0.0, 1.0);
  const Complex fast = 1.0 / (1.0 + i * omega * r.tau_s + lateral);
  return r.slow_share == 0.0 ? fast
                             : (1.0 - r.slow_share) * fast + r.slow_share / (1.0 + i * omega * r.slow_tau_s + lateral);
}

Complex readout_response(const Response& r, double omega) {
  const Complex i(0.0, 1.0);
  Complex factor = 1.0;
  const double turn = omega * r.window_s;
  if (std::abs(turn) > 1e-9) factor *= std::sin(turn / 2.0) / (turn / 2.0);
  if (r.filter == FrameFilter::kNone) return factor;
  const Complex back = std::exp(-i * omega * r.period_s);
  if (r.filter == FrameFilter::kRecursive) factor *= r.alpha / (1.0 - (1.0 - r.alpha) * back);
  if (r.filter == FrameFilter::kBox) factor *= r.alpha + (1.0 - r.alpha) * back;
  return factor;
}

// The n-th integral of a step blurred by a Gaussian.
double soft_step(int n, double x, double sigma) {
  const double z = x / std::max(sigma, 1e-6);
  double before = std::exp(-0.5 * z * z) / (std::max(sigma, 1e-6) * std::sqrt(2.0 * std::numbers::pi));
  double now = 0.5 * std::erfc(-z / std::numbers::sqrt2);
  for (int i = 1; i <= n; ++i) before = std::exchange(now, (x * now + sigma * sigma * before) / i);
  return now;
}

// The same, convolved with boxes of these widths.
double boxed_step(std::span<const double> widths, int n, double x, double sigma) {
  if (widths.empty()) return soft_step(n, x, sigma);
  constexpr double kNarrow = 0.005;  // px: narrower boxes have no effect
  const double w = widths.front();
  if (w < kNarrow) return boxed_step(widths.subspan(1), n, x, sigma);
  const auto at = [&](double place) { return boxed_step(widths.subspan(1), n + 1, place, sigma); };
  return (at(x + w / 2.0) - at(x - w / 2.0)) / w;
}

// Linear interpolation in a table at a non-negative index.
double interpolated(const std::vector<double>& values, double at) {
  const std::size_t i = std::min(static_cast<std::size_t>(at), values.size() - 2);
  return values[i] + (at - static_cast<double>(i)) * (values[i + 1] - values[i]);
}

double sinc(double x) { return std::abs(x) < 1e-9 ? 1.0 : std::sin(std::numbers::pi * x) / (std::numbers::pi * x); }

constexpr double kLow = 200.0;
constexpr double kTemperatureStep = 0.25;
constexpr int kPoints = 2001;
constexpr double kReference = 300.0;

double planck(double temperature_k) {
  constexpr double kC2 = 0.014387768775;  // h c / k, m K
  constexpr double kFrom = 7.5e-6;
  constexpr double kTo = 14e-6;
  constexpr int kParts = 64;
  double sum = 0.0;
  for (int i = 0; i < kParts; ++i) {
    const double um = kFrom + (kTo - kFrom) * (i + 0.5) / kParts;
    sum += std::pow(um * 1e5, -5.0) / (std::exp(kC2 / (um * temperature_k)) - 1.0);
  }
  return sum;
}

struct Table {
  std::array<double, kPoints> signal{};
  Table() {
    const double at = planck(kReference);
    const double slope = (planck(kReference + 0.01) - planck(kReference - 0.01)) / 0.02;
    for (int i = 0; i < kPoints; ++i) {
      signal[static_cast<std::size_t>(i)] = kReference + (planck(kLow + kTemperatureStep * i) - at) / slope;
    }
  }
};

const Table& table() {
  static const Table made;
  return made;
}

// The temperature of a signal, by Newton's method from an initial guess.
template <typename SignalOf>
double solved(const SignalOf& signal_of, double signal, double temperature_k, int rounds) {
  for (int i = 0; i < rounds; ++i) {
    const double slope = (signal_of(temperature_k + 0.05) - signal_of(temperature_k - 0.05)) / 0.1;
    temperature_k += (signal - signal_of(temperature_k)) / slope;
  }
  return temperature_k;
}

}  // namespace

void StepResponse::Pole::run(double dt, double input) noexcept {
  const double decay = std::exp(-dt / tau_s);
  integral += input * dt + (value - input) * tau_s * (1.0 - decay);
  value = input + (value - input) * decay;
}

StepResponse::StepResponse(std::span<const Step> steps, const Response& response)
    : nodes_{{-1e9, 0.0, {response.tau_s}, {response.slow_tau_s}}},
      slow_share_(response.slow_share),
      window_s_(response.window_s) {
  for (const Step& step : steps) {
    Node node = node_at(step.t_s);
    node.input += step.height;
    nodes_.push_back(node);
  }
}

StepResponse::Node StepResponse::node_at(double t_s) const noexcept {
  Node node = *std::prev(std::ranges::upper_bound(nodes_, t_s, {}, &Node::t_s));
  const double dt = t_s - std::exchange(node.t_s, t_s);
  node.fast.run(dt, node.input);
  if (slow_share_ != 0.0) node.slow.run(dt, node.input);
  return node;
}

double StepResponse::mixed(const Node& node, double Pole::*of) const noexcept {
  return (1.0 - slow_share_) * (node.fast.*of) + slow_share_ * (node.slow.*of);
}

double StepResponse::at(double t_s) const noexcept {
  if (window_s_ < 1e-7) {  // as node_at(), without the integrals: most of the time of a fit to a chopper
    const Node& node = *std::prev(std::ranges::upper_bound(nodes_, t_s, {}, &Node::t_s));
    const auto value = [&node, dt = t_s - node.t_s](const Pole& pole) {
      return node.input + (pole.value - node.input) * std::exp(-dt / pole.tau_s);
    };
    return (1.0 - slow_share_) * value(node.fast) + slow_share_ * (slow_share_ != 0.0 ? value(node.slow) : 0.0);
  }
  const auto integral = [this](double until_s) { return mixed(node_at(until_s), &Pole::integral); };
  return (integral(t_s + window_s_ / 2.0) - integral(t_s - window_s_ / 2.0)) / window_s_;
}

BarShape::BarShape(const Bars& of, double blur_px2, const std::function<double(double)>& signal)
    : bars(of), spectrum(BarTable::kPhases / 2 + 1) {
  spectrum[0] = bars.bar_width_px / bars.period_px * BarTable::kPhases;
  const double blur = blur_px2 * (1.0 + bars.slant_px_per_row * bars.slant_px_per_row) + bars.edge_px2;
  sigma_px = std::sqrt(std::max(0.0, blur));
  for (std::size_t n = 1; n < spectrum.size() - 1; ++n) {
    const double f = static_cast<double>(n) / bars.period_px;  // cycles per pixel
    const double gauss = kTwoPi * kTwoPi / 2.0 * f * f * blur;
    if (gauss > 40.0) break;
    const double turn = kTwoPi * f * bars.bar_width_px;
    const Complex bar = (1.0 - std::exp(Complex(0.0, -turn))) / Complex(0.0, kTwoPi * static_cast<double>(n));
    spectrum[n] = bar * sinc(f * bars.aperture_px) * sinc(f * bars.ramp_px) * std::exp(-gauss) *
                  static_cast<double>(BarTable::kPhases);
  }
  if (!signal) return;
  Eigen::FFT<double> fft;
  fft.SetFlag(Eigen::FFT<double>::HalfSpectrum);
  std::vector<double> phases(BarTable::kPhases);
  fft.inv(phases, spectrum, BarTable::kPhases);
  for (double& p : phases) p = signal(p);
  fft.fwd(spectrum, phases);
  if (bars.velocity_px_s != 0.0) return;
  for (int i = 0; i <= kTableShares; ++i) signal_of_share.push_back(signal(static_cast<double>(i) / kTableShares));
}

BarTable::BarTable(const BarShape& shape, const Response& response)
    : bars_(shape.bars), still_(bars_.velocity_px_s == 0.0), sigma_px_(shape.sigma_px), signal_(shape.signal_of_share) {
  std::vector<Complex> spectrum = shape.spectrum;
  for (std::size_t n = 1; n < spectrum.size() - 1; ++n) {
    if (spectrum[n] == 0.0) continue;
    const double f = static_cast<double>(n) / bars_.period_px;
    double lateral = 2.0 * response.coupling;
    if (lateral != 0.0) lateral *= 2.0 - std::cos(kTwoPi * f) - std::cos(kTwoPi * f * bars_.slant_px_per_row);
    const double omega = -kTwoPi * f * bars_.velocity_px_s;
    const Complex factor = thermal(response, omega, lateral) * readout_response(response, omega);
    spectrum[n] *= still_ ? factor - 1.0 : factor;
  }
  if (still_) {
    // The truncated series is inexact at a sharp edge: it is used for conduction only.
    spectrum.front() = 0.0;
    spectrum.back() = 0.0;
  }
  Eigen::FFT<double> fft;
  fft.SetFlag(Eigen::FFT<double>::HalfSpectrum);
  std::vector<double> phases(BarTable::kPhases);
  fft.inv(phases, spectrum, BarTable::kPhases);
  value_.assign(phases.begin(), phases.end());
  value_.push_back(value_.front());
}

double BarTable::covered(double phase_px) const noexcept {
  const std::array widths{bars_.aperture_px, bars_.ramp_px};
  const double u = phase_px - bars_.period_px * std::floor(phase_px / bars_.period_px);
  double share = 0.0;
  for (int m = -1; m <= 1; ++m) {
    const double from = u - m * bars_.period_px;
    share += boxed_step(widths, 0, from, sigma_px_) - boxed_step(widths, 0, from - bars_.bar_width_px, sigma_px_);
  }
  if (signal_.empty()) return share;
  return interpolated(signal_, std::clamp(share, 0.0, 1.0) * kTableShares);
}

double BarTable::at(double phase_px) const noexcept {
  const double value = moving_at(cell(phase_px));
  return still_ ? covered(phase_px) + value : value;
}

double BarTable::slope(double phase_px) const noexcept {
  constexpr double kHalf = 0.02;  // px
  return (at(phase_px + kHalf) - at(phase_px - kHalf)) / (2.0 * kHalf);
}

double band_signal(double temperature_k) noexcept {
  const double at = std::clamp((temperature_k - kLow) / kTemperatureStep, 1.0, kPoints - 3.0);
  const auto i = static_cast<std::size_t>(at);
  const auto& s = table().signal;
  const double f = (temperature_k - kLow) / kTemperatureStep - static_cast<double>(i);
  const double bend = (s[i + 2] - s[i + 1] - s[i] + s[i - 1]) / 4.0;  // second difference, for quadratic interpolation
  return s[i] + f * (s[i + 1] - s[i]) - bend * f * (1.0 - f);
}

double band_temperature(double signal) noexcept {
  const auto& s = table().signal;
  const auto next = std::upper_bound(s.begin() + 1, s.end() - 2, signal);
  return solved(band_signal, signal, kLow + kTemperatureStep * static_cast<double>(next - s.begin()), 2);
}

double mixed_signal(double temperature_k, double share) noexcept {
  return share == 0.0 ? temperature_k : temperature_k + share * (band_signal(temperature_k) - temperature_k);
}

double mixed_temperature(double signal, double share) noexcept {
  if (share == 0.0) return signal;
  return solved([share](double t) { return mixed_signal(t, share); }, signal, signal, 4);
}

TemperatureTable::TemperatureTable(double share, double low, double high) : low_(low) {
  constexpr int kCells = 600;
  const double width = std::max(1e-6, (high - low) / kCells);
  scale_ = 1.0 / width;
  for (int i = 0; i <= kCells + 1; ++i) value_.push_back(mixed_temperature(low + width * i, share));
}

double TemperatureTable::at(double signal) const noexcept {
  return interpolated(value_, std::max(0.0, (signal - low_) * scale_));
}

}  // namespace bolo::diagnose

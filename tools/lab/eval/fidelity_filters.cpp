#include "tools/lab/eval/fidelity.hpp"

#include <algorithm>
#include <complex>
#include <map>
#include <numeric>

#include <Eigen/Dense>
#include <unsupported/Eigen/FFT>

#include "src/core/statistics.hpp"

namespace bolo::tools::fidelity {
namespace {

constexpr double kTrail = 6.0;        // kernel length in time constants; 0.25 % is cut off
constexpr double kStepPx = 0.05;      // integration step along the trail
constexpr int kRamp = 64;             // columns that join the left and right borders of a padded picture
constexpr double kCorner = 1.0 / 64;  // f0, cycles a pixel

// Even, and with small prime factors only, for the FFT.
int padded_length(int wanted) {
  const auto smooth = [](int n) {
    for (const int p : {2, 3, 5}) {
      while (n % p == 0) n /= p;
    }
    return n == 1;
  };
  while (!smooth(wanted)) ++wanted;
  return wanted;
}

// Weight of the opposite border in a padding element: 0 inside, then a ramp over the padding.
double ramp(int i, int length, int padded) {
  return i < length ? 0.0 : static_cast<double>(i - length + 1) / (padded - length + 1);
}

int steps_along(double length_px) { return std::max(1, static_cast<int>(std::ceil(length_px / kStepPx))); }

// Integral of exp(-age / tau) over the pixel's trail; `shown_at(age_s)` is its distance from the pixel at that age.
template <typename ShownAt>
std::vector<Tap> trail_kernel(int steps, double tau_s, ShownAt&& shown_at) {
  std::map<std::pair<int, int>, double> sum;
  double whole = 0.0;
  for (int i = 0; i < steps; ++i) {
    const double from = kTrail * i / steps;
    const double to = kTrail * (i + 1) / steps;
    const double weight = std::exp(-from) - std::exp(-to);
    const sim::Position shown = shown_at(tau_s * (from + to) / 2.0);
    const int ix = static_cast<int>(std::floor(shown.x_px));
    const int iy = static_cast<int>(std::floor(shown.y_px));
    const double fx = shown.x_px - ix;
    const double fy = shown.y_px - iy;
    sum[{iy, ix}] += weight * (1 - fx) * (1 - fy);
    sum[{iy, ix + 1}] += weight * fx * (1 - fy);
    sum[{iy + 1, ix}] += weight * (1 - fx) * fy;
    sum[{iy + 1, ix + 1}] += weight * fx * fy;
    whole += weight;
  }
  std::vector<Tap> kernel;
  for (const auto& [place, weight] : sum) {
    if (weight > 1e-9) kernel.push_back({place.second, place.first, static_cast<float>(weight / whole)});
  }
  return kernel;
}

constexpr std::array kNoiseToSignal{1e-6, 1e-5, 1e-4, 3e-4, 1e-3, 3e-3, 1e-2};

}  // namespace

std::vector<Tap> motion_kernel(sim::Position content_px_s, double tau_s) {
  const double speed = std::hypot(content_px_s.x_px, content_px_s.y_px);
  return trail_kernel(steps_along(speed * kTrail * tau_s), tau_s, [&](double age_s) {
    return sim::Position{content_px_s.x_px * age_s, content_px_s.y_px * age_s};
  });
}

std::vector<Tap> path_kernel(const sim::Path& path, double t_s, double tau_s, double factor) {
  constexpr int kPieces = 64;
  const sim::Position now = path.at(t_s);
  const auto shown_at = [&](double age_s) {
    const sim::Position then = path.at(t_s - age_s);
    return sim::Position{factor * (then.x_px - now.x_px), factor * (then.y_px - now.y_px)};
  };
  double length_px = 0.0;
  for (int i = 0; i < kPieces; ++i) {
    const sim::Position from = shown_at(kTrail * tau_s * i / kPieces);
    const sim::Position to = shown_at(kTrail * tau_s * (i + 1) / kPieces);
    length_px += std::hypot(to.x_px - from.x_px, to.y_px - from.y_px);
  }
  return trail_kernel(std::max(kPieces, steps_along(length_px)), tau_s, shown_at);
}

SpatialWiener::SpatialWiener(const Plane& image, Geometry g, const std::vector<Tap>& kernel)
    : geometry_(g),
      padded_{padded_length(g.width + kRamp), padded_length(g.height + kRamp)},
      mean_(std::accumulate(image.begin(), image.end(), 0.0) / static_cast<double>(image.size())) {
  image_ = kernel_ = Spectrum::Zero(padded_.height, padded_.width);
  const auto value = [&](int x, int y) { return static_cast<double>(image[at(g, x, y)]) - mean_; };
  for (int y = 0; y < padded_.height; ++y) {
    const double wy = ramp(y, g.height, padded_.height);
    const int near_y = std::min(y, g.height - 1);
    for (int x = 0; x < padded_.width; ++x) {
      const double wx = ramp(x, g.width, padded_.width);
      const int near_x = std::min(x, g.width - 1);
      const double upper = std::lerp(value(near_x, near_y), value(0, near_y), wx);
      const double lower = std::lerp(value(near_x, 0), value(0, 0), wx);
      image_(y, x) = static_cast<float>(std::lerp(upper, lower, wy));
    }
  }
  const auto wrapped = [](int d, int length) { return ((-d) % length + length) % length; };
  for (const Tap& tap : kernel) {
    kernel_(wrapped(tap.dy, padded_.height), wrapped(tap.dx, padded_.width)) += tap.weight;
  }
  transform(image_, false);
  transform(kernel_, false);
}

void SpatialWiener::transform(Spectrum& spectrum, bool back) {
  Eigen::FFT<float> fft;
  const auto along = [&](auto&& line) {
    const Eigen::VectorXcf in = line;
    Eigen::VectorXcf out(in.size());
    back ? fft.inv(out, in) : fft.fwd(out, in);
    line = out;
  };
  for (Eigen::Index y = 0; y < spectrum.rows(); ++y) along(spectrum.row(y).transpose());
  for (Eigen::Index x = 0; x < spectrum.cols(); ++x) along(spectrum.col(x));
}

Plane SpatialWiener::restore(double noise_to_signal) const {
  Spectrum out = image_;
  const auto frequency = [](int i, int length) {
    return static_cast<double>(i <= length / 2 ? i : i - length) / length;
  };
  for (int y = 0; y < padded_.height; ++y) {
    const double fy = frequency(y, padded_.height);
    for (int x = 0; x < padded_.width; ++x) {
      const double fx = frequency(x, padded_.width);
      const std::complex<double> h(kernel_(y, x));
      const double wanted = noise_to_signal * (fx * fx + fy * fy + kCorner * kCorner) / (kCorner * kCorner);
      out(y, x) = std::complex<float>(std::conj(h) * std::complex<double>(image_(y, x)) / (std::norm(h) + wanted));
    }
  }
  transform(out, true);
  Plane plane(geometry_.pixels());
  for (int y = 0; y < geometry_.height; ++y) {
    for (int x = 0; x < geometry_.width; ++x) {
      plane[at(geometry_, x, y)] = static_cast<float>(static_cast<double>(out(y, x).real()) + mean_);
    }
  }
  return plane;
}

void Oracle::offer(Planes tried, std::string setting) {
  const double error = rmse(tried, truth_);
  if (!planes_.empty() && error >= error_) return;
  error_ = error;
  planes_ = std::move(tried);
  setting_ = std::move(setting);
}

void try_wiener(const Sequence& s, const std::vector<std::vector<Tap>>& kernels, Oracle& oracle) {
  const CleanSequence& clean = *s.clean;
  std::vector<SpatialWiener> wieners;
  for (std::size_t i = 0; i < clean.targets.size(); ++i) {
    wieners.emplace_back(s.kelvin(clean.targets[i]), clean.geometry, kernels[i]);
  }
  for (const double strength : kNoiseToSignal) {
    oracle.offer(mapped(wieners,
                        [&](const SpatialWiener& wiener) {
                          return cut(wiener.restore(strength), clean.geometry, clean.judged);
                        }),
                 plot::format("noise to signal %g", strength));
  }
}

}  // namespace bolo::tools::fidelity

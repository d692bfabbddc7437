#include "tools/lab/eval/fidelity.hpp"

#include <algorithm>
#include <complex>
#include <map>
#include <numeric>

#include <Eigen/Dense>
#include <unsupported/Eigen/FFT>

namespace bolo::tools::fidelity {
namespace {

constexpr double kTrail = 6.0;        // time constants that a kernel reaches back; 0.25 % is left beyond
constexpr double kStepPx = 0.05;      // of the integral along the trail
constexpr int kRamp = 64;             // columns that join the left and right borders of a padded picture
constexpr double kCorner = 1.0 / 64;  // f0, cycles a pixel

// The reach of a kernel on every side.
struct Reach {
  int left = 0;
  int right = 0;
  int up = 0;
  int down = 0;
};

Reach reach_of(const std::vector<Tap>& kernel) {
  Reach reach;
  for (const Tap& tap : kernel) {
    reach.left = std::max(reach.left, -tap.dx);
    reach.right = std::max(reach.right, tap.dx);
    reach.up = std::max(reach.up, -tap.dy);
    reach.down = std::max(reach.down, tap.dy);
  }
  return reach;
}

// The picture with its border pixels repeated outwards as far as the kernel reaches.
Plane extended(const Plane& image, Geometry g, const Reach& reach, Geometry& size) {
  size = {g.width + reach.left + reach.right, g.height + reach.up + reach.down};
  Plane out(size.pixels());
  for (int y = 0; y < size.height; ++y) {
    const int from_y = std::clamp(y - reach.up, 0, g.height - 1);
    for (int x = 0; x < size.width; ++x) {
      out[at(size, x, y)] = image[at(g, std::clamp(x - reach.left, 0, g.width - 1), from_y)];
    }
  }
  return out;
}

std::vector<Tap> turned(std::vector<Tap> kernel) {
  for (Tap& tap : kernel) {
    tap.dx = -tap.dx;
    tap.dy = -tap.dy;
  }
  return kernel;
}

// Even, and with small factors only, for the transform.
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

// How much of the far border a padding element takes: 0 inside, then a ramp over the padding.
double ramp(int i, int length, int padded) {
  return i < length ? 0.0 : static_cast<double>(i - length + 1) / (padded - length + 1);
}

int steps_along(double length_px) { return std::max(1, static_cast<int>(std::ceil(length_px / kStepPx))); }

// The integral of exp(-age / tau) over what the pixels looked at: `shown_at(age_s)` is how far from the pixel, now.
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

constexpr std::array kUnsharpSigmas{1.0, 2.0, 4.0, 8.0};
constexpr std::array kUnsharpAmounts{0.25, 0.5, 1.0, 2.0, 4.0};
constexpr std::array kNoiseToSignal{1e-6, 1e-5, 1e-4, 3e-4, 1e-3, 3e-3, 1e-2};

// Applies a filter of whole frames to every target.
template <typename Filter>
Planes filtered(const Sequence& s, Filter&& filter) {
  Planes planes;
  for (std::size_t i = 0; i < s.clean->targets.size(); ++i) {
    planes.push_back(cut(filter(i), s.clean->geometry, s.clean->judged));
  }
  return planes;
}

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

Plane blur(const Plane& image, Geometry g, const std::vector<Tap>& kernel) {
  const Reach reach = reach_of(kernel);
  Geometry size;
  const Plane wide = extended(image, g, reach, size);
  Plane out(image.size(), 0.0F);
  for (int y = 0; y < g.height; ++y) {
    float* row = out.data() + at(g, 0, y);
    for (const Tap& tap : kernel) {
      const float* from = wide.data() + at(size, reach.left + tap.dx, reach.up + y + tap.dy);
      for (int x = 0; x < g.width; ++x) row[x] += tap.weight * from[x];
    }
  }
  return out;
}

Plane blur_transposed(const Plane& image, Geometry g, const std::vector<Tap>& kernel) {
  return blur(image, g, turned(kernel));
}

Plane unsharp_mask(const Plane& image, Geometry g, double sigma_px, double amount) {
  const int radius = static_cast<int>(std::ceil(3.0 * sigma_px));
  std::vector<Tap> across;
  double sum = 0.0;
  for (int d = -radius; d <= radius; ++d) sum += std::exp(-0.5 * d * d / (sigma_px * sigma_px));
  for (int d = -radius; d <= radius; ++d) {
    across.push_back({d, 0, static_cast<float>(std::exp(-0.5 * d * d / (sigma_px * sigma_px)) / sum)});
  }
  std::vector<Tap> down = across;
  for (Tap& tap : down) std::swap(tap.dx, tap.dy);
  Plane out = blur(blur(image, g, across), g, down);
  const auto weight = static_cast<float>(amount);
  for (std::size_t i = 0; i < out.size(); ++i) out[i] = image[i] + weight * (image[i] - out[i]);
  return out;
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

std::vector<Plane> richardson_lucy(const Plane& image, Geometry g, const std::vector<Tap>& kernel,
                                   const std::vector<int>& iterations) {
  const float floor = *std::ranges::min_element(image) - 1.0F;  // 1 K: the iteration needs positive values
  Plane data(image.size());
  std::ranges::transform(image, data.begin(), [floor](float v) { return v - floor; });
  Plane estimate = data;
  std::vector<Plane> results;
  int done = 0;
  for (const int wanted : iterations) {
    for (; done < wanted; ++done) {
      Plane ratio = blur(estimate, g, kernel);
      for (std::size_t i = 0; i < ratio.size(); ++i) ratio[i] = data[i] / ratio[i];
      const Plane factor = blur_transposed(ratio, g, kernel);
      for (std::size_t i = 0; i < estimate.size(); ++i) estimate[i] *= factor[i];
    }
    Plane kelvin = estimate;
    for (float& v : kelvin) v += floor;
    results.push_back(std::move(kelvin));
  }
  return results;
}

TemporalWiener::TemporalWiener(const Sequence& training, int lookahead)
    : lookahead_(lookahead), weights_(kWindow, 0.0) {
  // Relative to the newest sample: a sum of 1 needs no constraint then.
  constexpr int kFree = kWindow - 1;
  constexpr std::size_t kEveryPixel = 2;
  Eigen::MatrixXd normal = Eigen::MatrixXd::Zero(kFree, kFree);
  Eigen::VectorXd right = Eigen::VectorXd::Zero(kFree);
  const CleanSequence& clean = *training.clean;
  for (const std::size_t target : clean.targets) {
    Planes window;
    const std::size_t oldest = target + static_cast<std::size_t>(lookahead) + 1 - kWindow;
    for (std::size_t s = 0; s < kWindow; ++s) {
      window.push_back(cut(training.kelvin(oldest + s), clean.geometry, clean.judged));
    }
    Eigen::MatrixXd rows(kFree, static_cast<Eigen::Index>(clean.truth[target].size() / kEveryPixel));
    Eigen::VectorXd wanted(rows.cols());
    for (Eigen::Index c = 0; c < rows.cols(); ++c) {
      const auto p = static_cast<std::size_t>(c) * kEveryPixel;
      const auto newest = static_cast<double>(window[kFree][p]);
      for (int s = 0; s < kFree; ++s) rows(s, c) = static_cast<double>(window[static_cast<std::size_t>(s)][p]) - newest;
      wanted[c] = static_cast<double>(clean.truth[target][p]) - newest;
    }
    normal.noalias() += rows * rows.transpose();
    right.noalias() += rows * wanted;
  }
  normal.diagonal().array() += 1e-9 * normal.trace();
  const Eigen::VectorXd solved = normal.ldlt().solve(right);
  for (int s = 0; s < kFree; ++s) weights_[static_cast<std::size_t>(s)] = solved[s];
  weights_[kFree] = 1.0 - solved.sum();
}

Planes TemporalWiener::apply(const Sequence& sequence) const {
  Planes out;
  const CleanSequence& clean = *sequence.clean;
  for (const std::size_t target : clean.targets) {
    std::vector<double> sum(clean.geometry.pixels(), 0.0);
    const std::size_t oldest = target + static_cast<std::size_t>(lookahead_) + 1 - kWindow;
    for (std::size_t s = 0; s < weights_.size(); ++s) {
      const auto& values = sequence.frames[oldest + s];
      for (std::size_t i = 0; i < sum.size(); ++i) sum[i] += weights_[s] * static_cast<double>(values[i]);
    }
    Plane kelvin(sum.size());
    std::ranges::transform(sum, kelvin.begin(),
                           [&](double v) { return static_cast<float>(sequence.format.scale.to_physical(v)); });
    out.push_back(cut(kelvin, clean.geometry, clean.judged));
  }
  return out;
}

double Oracle::offer(Planes tried, std::string setting) {
  const double error = rmse(tried, truth_);
  if (best_.planes.empty() || error < error_) {
    error_ = error;
    best_ = {std::move(tried), std::move(setting)};
  }
  return error;
}

Picked picked_unsharp(const Sequence& s, const Planes& truth, const Planes& frames) {
  Oracle oracle(truth);
  for (const double sigma : kUnsharpSigmas) {
    for (const double amount : kUnsharpAmounts) {
      oracle.offer(
          filtered(s, [&](std::size_t i) { return unsharp_mask(frames[i], s.clean->geometry, sigma, amount); }),
          plot::format("sigma %g px, amount %g", sigma, amount));
    }
  }
  return oracle.best();
}

Picked picked_wiener(const SpatialTask& task) {
  Oracle oracle(task.truth);
  std::vector<SpatialWiener> wieners;
  for (std::size_t i = 0; i < task.frames.size(); ++i) {
    wieners.emplace_back(task.frames[i], task.sequence.clean->geometry, task.kernels[i]);
  }
  for (const double strength : kNoiseToSignal) {
    oracle.offer(filtered(task.sequence, [&](std::size_t i) { return wieners[i].restore(strength); }),
                 plot::format("noise to signal %g", strength));
  }
  return oracle.best();
}

Picked picked_lucy(const SpatialTask& task, std::span<const int> iterations) {
  Oracle oracle(task.truth);
  std::vector<std::vector<Plane>> results;
  for (std::size_t i = 0; i < task.frames.size(); ++i) {
    results.push_back(richardson_lucy(task.frames[i], task.sequence.clean->geometry, task.kernels[i],
                                      {iterations.begin(), iterations.end()}));
  }
  for (std::size_t n = 0; n < iterations.size(); ++n) {
    oracle.offer(filtered(task.sequence, [&](std::size_t i) { return results[i][n]; }),
                 plot::format("%d iterations", iterations[n]));
  }
  return oracle.best();
}

}  // namespace bolo::tools::fidelity

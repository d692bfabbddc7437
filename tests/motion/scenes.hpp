// Moving scenes seen through thermal inertia, for tests.
#pragma once

#include <Eigen/Core>

#include "src/core/frame.hpp"
#include "src/motion/padded_plane.hpp"
#include "tests/test.hpp"

namespace bolo::motion::testing {

// A smooth, random, aperiodic texture: several waves of each length. K.
class Texture {
 public:
  explicit Texture(std::uint32_t seed, double contrast_k = 3.0) {
    std::mt19937 random(seed);
    std::uniform_real_distribution<double> unit(0.0, 1.0);
    for (int i = 0; i < kWaves; ++i) {
      const double length = 6.0 * std::pow(20.0, unit(random));  // 6 to 120 px
      const double angle = 6.283185 * unit(random);
      x_[i] = std::cos(angle) * 6.283185 / length;
      y_[i] = std::sin(angle) * 6.283185 / length;
      phase_[i] = 6.283185 * unit(random);
      amplitude_[i] = static_cast<float>(contrast_k * std::sqrt(length / 60.0) / std::sqrt(kWaves / 2.0));
    }
  }
  double operator()(double x, double y) const {
    const Eigen::Array<float, kWaves, 1> angle = (x * x_ + y * y_ + phase_).cast<float>();  // as floats: four at a time
    return static_cast<double>((angle.sin() * amplitude_).sum());
  }

 private:
  static constexpr int kWaves = 24;
  Eigen::Array<double, kWaves, 1> x_;
  Eigen::Array<double, kWaves, 1> y_;
  Eigen::Array<double, kWaves, 1> phase_;
  Eigen::Array<float, kWaves, 1> amplitude_;
};

// Scene value at a pixel and a time (in frames).
using Scene = std::function<double(double x, double y, double t)>;

inline Scene pan(double vx, double vy, std::uint32_t seed = 3) {
  return [texture = Texture(seed), vx, vy](double x, double y, double t) { return texture(x - vx * t, y - vy * t); };
}

using Picture = std::vector<double>;

inline Picture picture_of(const Scene& scene, Geometry g, double t) {
  Picture p;
  p.reserve(g.pixels());
  for (int y = 0; y < g.height; ++y) {
    for (int x = 0; x < g.width; ++x) p.push_back(scene(x, y, t));
  }
  return p;
}

// Frames 0 to count - 1 without noise, of pixels with time constant tau (periods).
inline constexpr int kLead = 3;  // frames before the first; the pixels start in equilibrium with the earliest

inline std::vector<Picture> watch(const Scene& scene, Geometry g, double tau, int count, int steps = 8) {
  Picture y = picture_of(scene, g, -kLead);
  std::vector<Picture> frames;
  const double keep = std::exp(-1.0 / (steps * tau));
  for (int k = 1 - kLead; k < count; ++k) {
    for (int s = 1; s <= steps; ++s) {
      const Picture x = picture_of(scene, g, k - 1 + (s - 0.5) / steps);
      for (std::size_t i = 0; i < y.size(); ++i) y[i] = keep * y[i] + (1.0 - keep) * x[i];
    }
    if (k >= 0) frames.push_back(y);
  }
  return frames;
}

inline void add_noise(std::vector<Picture>& frames, double sigma, std::uint32_t seed) {
  std::mt19937 random(seed);
  std::normal_distribution<double> normal(0.0, sigma);
  for (Picture& frame : frames) {
    for (double& v : frame) v += normal(random);
  }
}

inline PaddedPlane padded(const Picture& picture, Geometry g) {
  PaddedPlane plane(g);
  for (int y = 0; y < g.height; ++y) {
    for (int x = 0; x < g.width; ++x) {
      *plane.at(x, y) = static_cast<float>(
          picture[static_cast<std::size_t>(y) * static_cast<std::size_t>(g.width) + static_cast<std::size_t>(x)]);
    }
  }
  plane.extend();
  return plane;
}

inline double rmse(const Picture& a, const Picture& b) {
  double sum = 0.0;
  for (std::size_t i = 0; i < a.size(); ++i) sum += (a[i] - b[i]) * (a[i] - b[i]);
  return std::sqrt(sum / static_cast<double>(a.size()));
}

}  // namespace bolo::motion::testing

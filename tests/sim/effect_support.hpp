// Shared by the tests of effects: runs with effects, and a scene that reveals the time of each sample.
#pragma once

#include "tests/sim/support.hpp"

namespace bolo::sim::testing {

inline constexpr double kTau = 0.011;
inline constexpr double kPeriod = 0.005;

inline CameraSettings with(CameraSettings camera, std::initializer_list<std::string_view> effects) {
  for (const std::string_view text : effects) camera.effects.push_back(*must(parse_effect(text)));
  return camera;
}

inline Frames run(Geometry geometry, std::initializer_list<std::string_view> effects,
                  std::unique_ptr<const Field> field, std::size_t frames) {
  return run(with(ideal_camera(geometry), effects), std::move(field), frames);
}

// 30 mK of white noise, stored as float.
inline CameraSettings noisy_camera(Geometry geometry) {
  CameraSettings camera = ideal_camera(geometry);
  camera.readout.noise_k = 0.03;
  return camera;
}

// A temperature that rises along x and moves, so that every value reveals its time.
struct Ramp {
  static constexpr double kSpeed = 300.0;  // px/s
  static constexpr double kSlope = 0.2;    // K/px
  static std::unique_ptr<const Field> field(Geometry view, double to_s) {
    const auto scene = make_still_scene(columns(1200, view.height, [](int x) { return 280.0 + kSlope * x; }));
    auto field = pan_over(*scene, steady_pan(kSpeed), {600, 0}, view, -0.5, to_s);
    EXPECT_TRUE(field);
    return std::move(*field);
  }
  // Time at which a pixel in column x saw `kelvin`, minus the pixel's lag (tau, if linear).
  static double time_of(double kelvin, std::size_t x) {
    return (600.0 + static_cast<double>(x) - (kelvin - 280.0) / kSlope) / kSpeed;
  }
};

struct Stats {
  double mean = 0.0;
  double rms = 0.0;  // about the mean
  double kurtosis = 0.0;
};

inline Stats stats(const std::vector<double>& values) {
  Stats s;
  const auto n = static_cast<double>(values.size());
  for (const double v : values) s.mean += v / n;
  double fourth = 0.0;
  for (const double v : values) {
    s.rms += std::pow(v - s.mean, 2) / n;
    fourth += std::pow(v - s.mean, 4) / n;
  }
  s.kurtosis = fourth / (s.rms * s.rms);
  s.rms = std::sqrt(s.rms);
  return s;
}

inline double correlation(const std::vector<double>& a, const std::vector<double>& b) {
  const Stats sa = stats(a);
  const Stats sb = stats(b);
  double sum = 0.0;
  for (std::size_t i = 0; i < a.size(); ++i) sum += (a[i] - sa.mean) * (b[i] - sb.mean);
  return sum / (static_cast<double>(a.size()) * sa.rms * sb.rms);
}

inline std::vector<double> time_mean(const Frames& frames) {
  std::vector<double> mean(frames.shown.front().size());
  for (const auto& frame : frames.shown) {
    for (std::size_t i = 0; i < mean.size(); ++i) mean[i] += static_cast<double>(frame[i]);
  }
  for (double& value : mean) value /= static_cast<double>(frames.shown.size());
  return mean;
}

inline std::vector<double> frame_means(const Frames& frames) {
  std::vector<double> means;
  for (const auto& frame : frames.shown) {
    means.push_back(std::accumulate(frame.begin(), frame.end(), 0.0) / static_cast<double>(frame.size()));
  }
  return means;
}

inline std::vector<double> difference(std::vector<double> a, const std::vector<double>& b) {
  for (std::size_t i = 0; i < a.size(); ++i) a[i] -= b[i];
  return a;
}

// Values of frames [from, to), for correlations over time.
inline std::vector<double> all_values(const Frames& frames, std::size_t from, std::size_t to) {
  std::vector<double> values;
  for (std::size_t k = from; k < to; ++k) {
    for (const float v : frames.shown[k]) values.push_back(static_cast<double>(v));
  }
  return values;
}

inline double lag_correlation(const Frames& frames, std::size_t lag) {
  const std::size_t n = frames.shown.size();
  return correlation(all_values(frames, 0, n - lag), all_values(frames, lag, n));
}

// Response of a bolometer to one step from 295 to 320 K and back.
inline double chopped(double t_s, double on_s, double off_s, double tau_up = kTau, double tau_down = kTau) {
  if (t_s <= on_s) return 295.0;
  const double top = 320.0 - 25.0 * std::exp(-(std::min(t_s, off_s) - on_s) / tau_up);
  return t_s <= off_s ? top : 295.0 + (top - 295.0) * std::exp(-(t_s - off_s) / tau_down);
}

inline constexpr double kOn = 0.0131;
inline constexpr double kOff = 0.0772;
inline std::unique_ptr<const Field> one_pulse() { return make_chopper({295, {kOn}, {kOff}, {320}}); }

inline double at(const std::vector<float>& plane, std::size_t width, std::size_t x, std::size_t y) {
  return static_cast<double>(plane[y * width + x]);
}

}  // namespace bolo::sim::testing

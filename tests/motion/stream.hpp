#pragma once

#include "tests/deblur/solve.hpp"
#include "tests/motion/scenes.hpp"

namespace bolo::deblur::testing {

using motion::testing::add_noise;
using motion::testing::pan;
using motion::testing::Picture;
using motion::testing::picture_of;
using motion::testing::rmse;
using motion::testing::Scene;
using motion::testing::Texture;
using motion::testing::watch;

inline constexpr Geometry kFrame{133, 90};  // no multiple of the block size
inline constexpr int kWindow = 17;
inline constexpr double kScale = 0.01;

inline Settings settings_of(Method method, double noise_k, int lookahead = 0) {
  return {.method = method, .noise_k = noise_k, .lookahead = lookahead};
}

inline StreamFormat format_of(PixelType type) {
  return {kFrame, type, {Unit::kKelvin, type == PixelType::kUint16 ? kScale : 1.0, 0.0}};
}

// A solver for frames in counts, with output in kelvin.
inline std::unique_ptr<Solver> solver_of(const Settings& settings, double row_delay_s = 0.0) {
  return make(settings, format_of(PixelType::kUint16), PixelType::kFloat32, row_delay_s);
}

// Solved frame in the units of the scene (K above 300 K).
inline Picture solved(Solver& solver, const WindowView& window) {
  Picture p;
  for (const float v : whole_frame(solver, window, kFrame)) p.push_back(static_cast<double>(v) - 300.0);
  return p;
}

class Stream {
 public:
  // tau: pixel time constant in periods.
  Stream(const Scene& scene, double noise, int count, std::uint32_t seed = 1, double tau = 2.2) : scene_(scene) {
    auto frames = watch(scene, kFrame, tau, count);
    add_noise(frames, noise, seed);
    for (const Picture& frame : frames) {
      counts_.emplace_back();
      for (const double v : frame)
        counts_.back().push_back(static_cast<std::uint16_t>(std::lround((300.0 + v) / kScale)));
    }
  }
  int frames() const { return static_cast<int>(counts_.size()); }
  std::vector<std::uint16_t>& counts(int k) { return counts_[static_cast<std::size_t>(k)]; }
  void lose(int k) { counts(k).clear(); }
  // Adds a fixed pattern of standard deviation `pattern`, K, and loses the share `lost` of the frames.
  void disturb(double lost, double pattern, std::uint32_t seed) {
    std::mt19937 random(seed);
    std::normal_distribution<double> normal(0.0, pattern / kScale);
    std::bernoulli_distribution gone(lost);
    for (std::size_t i = 0; i < kFrame.pixels() && pattern > 0.0; ++i) {
      const long offset = std::lround(normal(random));
      for (auto& frame : counts_) frame[i] = static_cast<std::uint16_t>(frame[i] + offset);
    }
    for (int k = 0; k < frames(); ++k) {
      if (gone(random)) lose(k);
    }
  }

  WindowView window_ending_at(int k, int lookahead) {
    planes_.clear();
    for (int i = k - kWindow + 1; i <= k; ++i) planes_.push_back(counts(i).empty() ? nullptr : counts(i).data());
    return {planes_, kWindow - 1 - lookahead, static_cast<std::uint64_t>(k) + 1};
  }
  // Estimate of frame k, K, by a solver that has seen the stream from frame `first` on.
  Picture estimate(const Settings& settings, int k, int first = kWindow - 1) {
    const auto solver = solver_of(settings);
    for (int j = first; j < k + settings.lookahead; ++j) {
      if (!counts(j - settings.lookahead).empty()) solver->prepare(window_ending_at(j, settings.lookahead));
    }
    return solved(*solver, window_ending_at(k + settings.lookahead, settings.lookahead));
  }
  Picture truth(int k) const { return picture_of(scene_, kFrame, k); }
  double error(const Settings& settings, int k) { return rmse(estimate(settings, k), truth(k)); }
  double blurred_error(int k) {
    Picture p;
    for (const std::uint16_t v : counts(k)) p.push_back(v * kScale - 300.0);
    return rmse(p, truth(k));
  }

 private:
  Scene scene_;
  std::vector<std::vector<std::uint16_t>> counts_;
  std::vector<const void*> planes_;
};

}  // namespace bolo::deblur::testing

// Sequences' filters: baselines that a person would try, and their strengths picked with the truth.
#pragma once

#include <array>
#include <span>
#include <string>
#include <vector>

#include "tools/lab/eval/fidelity_data.hpp"

namespace bolo::tools::fidelity {

// Blur as a sum: blurred(x, y) = sum of weight * sharp(x + dx, y + dy). The weights sum to 1.
struct Tap {
  int dx = 0;
  int dy = 0;
  float weight = 0.0F;
};

// The trail exp(-s / (v tau)) that thermal inertia leaves behind what moves over the pixels at a steady velocity, with
// the picture linear between pixels. Thread: any.
std::vector<Tap> motion_kernel(sim::Position content_px_s, double tau_s);

// The same for the way that the camera really went before `t_s`; `factor` stretches the trail: 1.1 for a speed that is
// thought 10 % too high. The path must go back 6 tau_s before. Thread: any.
std::vector<Tap> path_kernel(const sim::Path& path, double t_s, double tau_s, double factor = 1.0);

// The blur itself, and its transpose; the borders' pixels go on outwards. Thread: any.
Plane blur(const Plane& image, Geometry geometry, const std::vector<Tap>& kernel);
Plane blur_transposed(const Plane& image, Geometry geometry, const std::vector<Tap>& kernel);

// image + amount * (image - Gaussian of it). Thread: any.
Plane unsharp_mask(const Plane& image, Geometry geometry, double sigma_px, double amount);

// Spatial Wiener filter with the known blur H: conj(H) / (|H|^2 + noise_to_signal * (f^2 + f0^2) / f0^2), for pictures
// whose power falls as 1 / (f^2 + f0^2), f0 = 1/64 cycles a pixel. Borders are joined by a smooth ramp. The transform
// of the picture is shared by all strengths. Thread: any, one object each.
class SpatialWiener {
 public:
  SpatialWiener(const Plane& image, Geometry geometry, const std::vector<Tap>& kernel);
  Plane restore(double noise_to_signal) const;

 private:
  struct Spectrum {
    std::vector<float> re;
    std::vector<float> im;
  };
  static void transform(Spectrum& spectrum, Geometry padded, bool back);

  Geometry geometry_;
  Geometry padded_;
  double mean_ = 0.0;
  Spectrum image_;
  Spectrum kernel_;
};

// Richardson and Lucy's iteration (1972, 1974) with the known blur, on kelvin above the plane's coldest pixel. One
// result for each entry of `iterations`, rising. Thread: any.
std::vector<Plane> richardson_lucy(const Plane& image, Geometry geometry, const std::vector<Tap>& kernel,
                                   const std::vector<int>& iterations);

// A per-pixel linear filter over the window's samples: one weight a sample, their sum 1. Least squares on the targets
// of another sequence, with its truth: the best any fixed linear temporal filter can do for motion and noise of this
// kind. Thread: any.
class TemporalWiener {
 public:
  TemporalWiener(const Sequence& training, int lookahead);
  // Every target of a sequence, judged part.
  Planes apply(const Sequence& sequence) const;
  const std::vector<double>& weights() const { return weights_; }  // oldest sample first

 private:
  int lookahead_;
  std::vector<double> weights_;
};

// --- Baselines whose strength is picked with the truth: the best that they can do, which nobody knows outside a
// simulator.

struct Picked {
  Planes planes;        // every target, judged part
  std::string setting;  // "sigma 2 px, amount 1"
};

// Keeps the best of several tries by their RMSE; the truth picks.
class Oracle {
 public:
  explicit Oracle(const Planes& truth) : truth_(truth) {}

  // Returns its RMSE.
  double offer(Planes tried, std::string setting);
  const Picked& best() const { return best_; }
  double rmse_k() const { return error_; }

 private:
  const Planes& truth_;
  Picked best_;
  double error_ = 0.0;
};

// What the filters of whole frames are given: a sequence's targets, their truth, and the blur that each is told.
struct SpatialTask {
  const Sequence& sequence;
  const Planes& truth;   // judged part
  const Planes& frames;  // whole
  const std::vector<std::vector<Tap>>& kernels;
};

inline constexpr std::array kIterations{1, 2, 4, 8, 16, 32, 64, 128};

// Thread of all: any, several at once.
Picked picked_unsharp(const Sequence& sequence, const Planes& truth, const Planes& frames);
Picked picked_wiener(const SpatialTask& task);
Picked picked_lucy(const SpatialTask& task, std::span<const int> iterations = kIterations);

}  // namespace bolo::tools::fidelity

// The models of multiple-model estimation: scenes that move past a pixel, seen through its thermal inertia, with noise.
//
// A model is a Gaussian process of the pixel's input x(t): the scene's autocovariance exp(-|r| / 10 px), smoothed by
// one pixel's width, with r = v t, times a variance given in units of the noise's. Seven speeds and nine variances, and
// a still scene: 64 models. With h the pixel's impulse response exp(-t / tau) / tau and r_v the autocovariance of x,
//   cov(y_i, y_j)   = (r_v * h * h_reversed)(t_i - t_j) + noise
//   cov(x(t), y_j)  = (r_v * h)(t_j - t)
// and for the samples' differences d = D y (which do not see the unknown mean) S = D cov(y) D^T. Given n neighbouring
// pixels with M = sum d d^T, the log likelihood is -1/2 tr(S^-1 M) - n/2 log det S; the best linear unbiased estimate
// of x(t) is w . y with weights that sum to 1. Source: Magill, "Optimal adaptive estimation of sampled stochastic
// processes" (1965), for the weighting of models.
#pragma once

#include <array>
#include <vector>

#include "src/deblur/grid.hpp"

namespace bolo::deblur {

inline constexpr int kModels = 64;
inline constexpr int kMostSamples = 17;  // the newest of the window; older ones add nothing at T / tau = 0.45
inline constexpr int kMostPairs = (kMostSamples - 1) * kMostSamples / 2;
inline constexpr int kTapStride = 32;  // weights of a model, padded to whole vectors

// The models for one pattern of lost frames, in the kernels' layout.
struct ModelTables {
  Pattern pattern;  // of the whole window
  int samples = 0;
  std::array<int, kMostSamples> slot{};  // of each sample, oldest first
  // If the samples lie symmetrically in time, the log likelihood splits into a part of the sums of every two
  // differences equally far from the ends, in place of the earlier ones, and a part of their differences, in place of
  // the later, which begin at `split`. Otherwise there is one part, of the differences themselves.
  int split = 0;
  int differences() const { return samples - 1; }
  int end_of_part(int i) const { return i < split ? split : differences(); }  // end of the part that difference i is in
  // log likelihood, tempered: sum_p score[p][k] M_p + n per_pixel[k] + prior[k]; p runs over pairs i <= j of each part
  // row by row, M in units of the noise's variance.
  alignas(64) std::array<std::array<float, kModels>, kMostPairs> score{};
  alignas(64) std::array<float, kModels> per_pixel{};
  alignas(64) std::array<float, kModels> prior{};
  // For each model the weights, and at kMostSamples their mean square error, in units of the noise's variance.
  struct Weights {
    alignas(64) std::array<std::array<float, kTapStride>, kModels> tap{};
  };
  std::vector<Weights> weights;  // one for each read-out offset
};

class MotionModels {
 public:
  // The estimate is x at `offsets_s` before the target's sample (0: at the sample; for rows read out later, the frame's
  // time lies before their sample). Thread: setup.
  MotionModels(const Settings& settings, std::vector<double> offsets_s);

  // Allocates the memory. Thread: setup.
  ModelTables make_tables() const;
  // No allocation. Some 0.5 ms. Thread: pipeline.
  void prepare(ModelTables& tables, const Pattern& pattern) const noexcept;

  // Samples of model `model` together with the truth: the lower Cholesky factor of the covariance of (y_0 .. y_slots-1
  // without noise, x at the first offset), row-major, size slots + 1, for unit noise variance. For tables of an
  // estimator's result on each model. Thread: setup.
  std::vector<double> joint_factor(int model) const;
  int slots() const noexcept { return slots_; }

 private:
  struct Speed {
    double px_per_s = 0.0;
    std::array<double, kMostSamples> samples{};                // cov(y_i, y_j) at lag |i - j|
    std::vector<std::array<double, kMostSamples>> with_truth;  // [offset][slot]: cov(x, y_slot)
  };
  void prepare_model(ModelTables& tables, int model) const noexcept;

  int window_;
  int slots_;   // number of the window's newest frames that are used
  int target_;  // among them
  double decay_;
  std::vector<double> offsets_s_;
  std::vector<Speed> speeds_;
};

}  // namespace bolo::deblur

// Covariances of the scene's values in the camera's frames, for the tables of weights: the model of weights.hpp.
#pragma once

#include <map>
#include <utility>
#include <vector>

#include "src/motion/kernels.hpp"

namespace bolo::motion {

// Autocovariance, at r px, of a scene of variance 1 that is smooth over `smooth` px. Thread: any.
double covariance_of(double r, double smooth) noexcept;

// Half the mean square difference, of a scene of variance 1 that moves at (x, y) px a frame, of two of the camera's
// values that lie `beside` px apart along y. Thread: any.
double structure_of(double tau_periods, double x, double y, double beside, double smooth) noexcept;

// A value that enters weights: of the frame `back` periods ago, `at` pixels along the motion.
struct Raw {
  int back = 0;
  double at = 0.0;
};

// Shares of equally spaced times.
struct Times {
  double first = 0.0;  // periods
  double step = 0.0;
  std::vector<float> share;
};

// Covariances for a scene of variance 1, `speed` px a frame, uncertain by `sigma` both ways. Thread: one at a time.
class SceneCovariances {
 public:
  SceneCovariances(double tau_periods, double speed, double sigma, double smooth);

  double of(const Raw& a, const Raw& b);
  double with_truth(const Raw& a) const { return mean(a, age_); }

 private:
  double mean(const Raw& apart, const Times& times) const;

  double speed_;
  double sigma_;
  float smooth_;
  Times age_;  // ages of y's inputs
  Times lag_;  // age differences of two values' inputs
  const Kernels& kernels_;
  std::map<std::pair<int, long long>, double> known_;
};

}  // namespace bolo::motion

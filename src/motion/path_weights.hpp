// Weights of the estimate for the frames' actual path (WeightTable's are for straight ones): the same model of scene,
// noise and uncertainty, evaluated for each frame at the picture's centre.
#pragma once

#include <array>
#include <span>

#include <Eigen/Dense>

#include "src/core/crew.hpp"
#include "src/motion/innovation.hpp"
#include "src/motion/path.hpp"
#include "src/motion/weights.hpp"

namespace bolo::motion {

class PathWeights {
 public:
  // The smallest of the table's uncertainties: under larger ones a bend does not matter.
  static constexpr int kLevels = 3;
  // For faster paths, px a frame, the steps of time are too coarse.
  static constexpr float kFastest = 25.0F;

  // `ahead`: 1 when the frame after the estimated one is known too. Thread: setup.
  PathWeights(const Inertia& inertia, int ahead);

  // Sets the path. No allocation. Thread: pipeline.
  void follow(const Path& path) noexcept;
  // Blur of the scene, 0 to 1 (smooth_of), from half the mean square differences of the past's mean over 1 px (`fine`)
  // and 2 px (`across`) perpendicular to the path, less its noise; `noise`: a frame's variance. No allocation.
  // Thread: pipeline.
  float blur(const Kernels& kernels, const Path& path, double fine, double across, double noise) const noexcept;
  // Covariances along a bent path for the least uncertainty; `blurred`: of the scene. No allocation. Thread: pipeline.
  void correlate(const Kernels& kernels, const Path& path, float blurred, Crew& crew) noexcept;

  // False if the last path is practically straight: there are no weights then. Thread: pipeline.
  bool bent() const noexcept { return bent_; }
  // From one value with weights to the next, 1 px. Thread: any.
  Vec2 step() const noexcept { return step_; }
  // Half the mean square difference over two pixels along the path, relative to that at lag_of(its speed). Thread: any.
  float lag_factor() const noexcept { return lag_factor_; }

  // Mean square difference of the frame and the past's mean moved onto it, due to the path and its least uncertainty,
  // relative to half the mean square difference over two pixels. Thread: any.
  float change() const noexcept { return change_; }

  // Makes the wanted cells' weights (WeightTable::kKinds), and covariances for them. No allocation. Thread: pipeline.
  void make(const Kernels& kernels, const Path& path, const std::array<bool, WeightTable::kKinds>& wanted,
            Crew& crew) noexcept;
  // Weights of the last make(); null: not wanted. Thread: any.
  const FilterWeights* at(std::size_t kind) const noexcept { return made_[kind] ? &weights_[kind] : nullptr; }

 private:
  static constexpr int kRows = 3 * kTaps + 2;
  using Matrix = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::ColMajor, kRows, kRows>;

  struct Covariances {
    Matrix scene;
    Eigen::Matrix<double, Eigen::Dynamic, 1, 0, kRows, 1> truth;
  };
  using Trails = std::array<SceneTrail, 5>;  // of the newest frame, the past's mean, the two before, the one after

  void set_trails(const Path& path, std::size_t level) noexcept;
  double fineness(const Kernels& kernels, Vec2 axis, double smooth) const noexcept;
  void set_noise(const Path& path) noexcept;
  void fill(const Kernels& kernels, std::size_t i, std::size_t j, std::size_t level) noexcept;
  void fill(const Kernels& kernels, std::span<const std::size_t> levels, Crew& crew) noexcept;
  void set_contrast(const Kernels& kernels) noexcept;

  Inertia inertia_;
  int ahead_;
  int rows_;
  bool bent_ = false;
  double speed_ = 0.0;   // px a frame
  float smooth_ = 0.0F;  // px
  double unit_ = 1.0;    // half the mean square difference over two pixels along the path, of a scene of variance 1
  float lag_factor_ = 1.0F;
  float change_ = 0.0F;
  Vec2 step_{1.0F, 0.0F};
  std::array<Trails, kLevels> trails_;  // by uncertainty
  std::array<Covariances, kLevels> covariances_;
  Matrix noise_;
  std::array<FilterWeights, WeightTable::kKinds> weights_;
  std::array<bool, WeightTable::kKinds> made_{};
};

}  // namespace bolo::motion

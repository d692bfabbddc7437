// Table of the estimate's weights for the frame, the past along the motion and the pixel's own past, by the scene's
// speed and contrast and the uncertainty of the motion.
//
// They are linear minimum-mean-square weights with unit sum. The model, in pixels and frame periods: the scene has the
// autocovariance c(R) = var (exp(-R / 5) + exp(-R / 30)) / 2, R = sqrt(r^2 + s^2) - s, s = 0.6 (1.0 in slow motion) for
// a sharp scene and 2 for a blurred one; weights for the scene at hand are between theirs.
// Pixel p of frame k shows
//   y_k(p) = mean over a of x_k(p + v a), a ~ exp(-a T / tau),
// plus white noise of variance 1 and a fixed pattern of 1/2. The velocity is uncertain along and across: covariances
// are means over it, both with the same nodes, or they would not be covariances.
//
// The noise that they leave is white across the motion, where the scene is not: a second filter removes it.
#pragma once

#include <array>
#include <cstdint>
#include <memory>
#include <span>
#include <vector>

#include "src/motion/kernels.hpp"

namespace bolo::motion {

// Below this speed, px a frame, any direction will do.
inline constexpr float kStill = 1e-3F;

class PathWeights;

// Length, px, over which a scene is taken to be smooth, at a speed in px a frame. `blurred` 0: kSmooth, more in slow
// motion, where less fine detail can be told from noise; 1: kBlurred. Thread: any.
inline constexpr double kSmooth = 0.6;
inline constexpr double kBlurred = 2.0;
double smooth_of(double speed, double blurred) noexcept;

// Covariance of noise and fixed pattern, noise variances, of values interpolated `apart` px apart. Thread: any.
double shared_noise(bool same_frame, double apart) noexcept;

class WeightTable {
 public:
  static constexpr std::size_t kContrasts = 11;
  static constexpr std::size_t kUncertainties = 5;
  static constexpr std::size_t kKinds = kContrasts * kUncertainties;  // of cells of one speed

  // For a kind: contrast over 2 px, noise variances; standard deviation of the speed, relative to it. Thread: any.
  static double contrast_of(std::size_t kind) noexcept;
  static double uncertainty_of(std::size_t kind) noexcept;

  // `tau_periods`: tau / T. `ahead`: 1 when the frame after the estimated one is known too. Made once a process for the
  // same arguments, and kept (1.6 MB); with and without look-ahead together, at little extra cost. Thread: setup.
  static std::shared_ptr<const WeightTable> of(double tau_periods, int ahead);

  // The cells around a point in the table, and their interpolation shares.
  struct Place {
    std::array<std::uint16_t, 8> cell{};
    std::array<float, 8> share{};
    float speed = 0.0F;    // place among the speeds, in cells
    float blurred = 0.0F;  // share of the blurred scene's weights
  };
  // For a speed (px a frame), half the mean square difference of the near past's mean over lag_of(speed), less its
  // noise, in units of the noise's variance, the speed's standard deviation over the speed, and the share of a
  // blurred scene's weights. Thread: any.
  Place place_of(float speed, float structure, float uncertainty, float blurred) const noexcept;
  // Weight of the far past, 0 to 1: more frames average out more noise, but blur the scene. `beside`: mean square error
  // that no weights can remove, noise variances. Thread: any.
  float far_gain(const Place& place, float beside) const noexcept;
  // Expected mean square error of the weights for the near past, noise variances. Thread: any.
  float near_error(const Place& place, const PathWeights* path = nullptr, float bent = 0.0F) const noexcept;
  // Error beyond noise of an estimate from a pixel's own newest values. Thread: any.
  float per_pixel_error(const Place& place) const noexcept;
  // Weights for a past's mean of kNear frames (`far` 0), of kPast (1), or between; `bent`: share of the path's weights
  // in those of the near past. Thread: any.
  void find(const Kernels& kernels, const Place& place, float far, FilterWeights& out,
            const PathWeights* path = nullptr, float bent = 0.0F) const noexcept;

  // Weights across the motion for what `along` makes; `structure`: half the mean square difference of the past's mean
  // over 2 px across, less its noise. `e`: direction of the motion. Thread: any.
  void find_across(const FilterWeights& along, const Place& place, Vec2 e, float structure,
                   AcrossWeights& out) const noexcept;

  // Expected mean square error after both, noise variances. Thread: any.
  static float error_of(const FilterWeights& along, const AcrossWeights& across) noexcept {
    return along.w[FilterWeights::kError] - (1.0F - across.error) * along.w[FilterWeights::kNoise];
  }

  // Ratio of the contrast at lag_of(a speed) to that at two pixels. Thread: any.
  float lag_factor(float speed, float blurred) const noexcept;

  // Distance, px, over which contrast is measured: along a long trail neighbours are alike. Thread: any.
  static float lag_of(float speed) noexcept;

 private:
  static constexpr std::size_t kSpeeds = 22;
  static constexpr std::size_t kCells = kSpeeds * kKinds;
  static constexpr int kRatios = 41;

  struct Scene {
    std::array<double, kSpeeds> smooth{};        // px
    std::array<float, kSpeeds> lag_factor{};     // of the contrast at lag_of(speed) to that at two pixels
    std::array<float, kSpeeds> across_factor{};  // of its contrast over 2 px to that of y across the motion
    // With the near past's mean, and the whole past's.
    std::array<std::vector<FilterWeights>, 2> cells{std::vector<FilterWeights>(kCells),
                                                    std::vector<FilterWeights>(kCells)};
    std::vector<float> near_error = std::vector<float>(kCells);  // squared, with the near past's
    std::vector<float> far_less = std::vector<float>(kCells);    // share of it that the far past removes
    std::vector<float> per_pixel = std::vector<float>(kCells);   // beyond noise, with a pixel's own newest values
    std::array<AcrossWeights, kRatios> across;  // by contrast over 2 px in units of the noise's variance
  };

  static float between(const std::array<float, kSpeeds>& values, float at) noexcept;
  template <typename Of>
  float of_scenes(float blurred, const Of& of) const noexcept;
  template <typename Of>
  float of_cells(const Place& place, const Of& of) const noexcept;
  float index_of(float speed) const noexcept;
  float lag_factor_at(float index, float blurred) const noexcept;
  WeightTable(double tau_periods, int ahead);  // without its cells
  void begin(Scene& scene, double blurred) const;
  // Fills the cells of the tables of one tau, without look-ahead and, if there are two, with it.
  static void fill(std::span<const std::shared_ptr<WeightTable>> tables);
  static void fill(std::span<const std::shared_ptr<WeightTable>> tables, std::size_t which, std::size_t speed,
                   std::size_t uncertainty);
  static void fill_across(Scene& scene) noexcept;
  static constexpr std::size_t cell(std::size_t speed, std::size_t contrast, std::size_t uncertainty) noexcept {
    return speed * kKinds + contrast * kUncertainties + uncertainty;
  }

  double tau_;
  int ahead_;
  std::array<double, kSpeeds> speed_{};
  std::array<float, kSpeeds> log_speed_{};
  std::array<Scene, 2> scenes_;  // sharp, blurred
};

}  // namespace bolo::motion

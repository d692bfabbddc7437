// Prediction error of the pixel equation on a camera's stream, and the time constant that minimises it.
//
// The equation is y_k = rho y_{k-1} + (1 - rho) x_k, rho = exp(-T / tau), x_k the scene during frame k. During an
// earlier frame j the scene was (y_j - rho y_{j-1}) / (1 - rho), and has moved by D since. So frame k should be
//   rho y_{k-1}(p) + (y_j - rho y_{j-1})(p - D).
// In steady motion that holds for every rho, because the blurred picture moves as a whole. Between two frames that were
// blurred by different velocities it holds only for the true rho, which is therefore the regression of
//   a = y_k - y_j(p - D)   on   b = y_{k-1} - y_{j-1}(p - D).
// The noise of y_{k-1} is in b: the regression uses an instrument q, the same difference of the earlier changes
// y_{k-2} - y_{k-3}, whose noise is in neither. Errors of D are proportional to the picture's gradient, which is
// projected out of a, b and q in each window of the picture, as are their means. x_k is itself blurred by the motion
// during frame k, differently in two frames; this blur, known from their velocities, is subtracted from a.
#pragma once

#include <array>
#include <span>
#include <vector>

#include "src/core/frame.hpp"
#include "src/deblur/settings.hpp"
#include "src/motion/global_motion.hpp"
#include "src/motion/innovation.hpp"
#include "src/motion/kernels.hpp"

namespace bolo::deblur {

struct GapFigures {
  double noise_k = 0.0;  // temporal, K (counts without kelvin)
  double speed = 0.0;    // of the picture at its fastest, px a frame
  // Root mean square residual of the prediction with the given time constant, over that of noise; 0: unknown, because
  // the picture's velocity changed too little.
  double ratio = 0.0;
  double tau_ratio = 0.0;          // the pixels' time constant over the given one; 0: unknown
  double tau_sigma = 0.0;          // standard error of tau_ratio
  double tau_periods = 0.0;        // the given time constant
  std::array<double, 3> square{};  // of the ratio, by powers of rho

  // The ratio for a time constant of `times` the given one. Thread: any.
  double ratio_with(double times) const;
};

class GapMeter {
 public:
  static constexpr int kFrames = 32;  // of a burst

  // Allocates all memory but a few kilobytes. Thread: setup.
  GapMeter(const StreamFormat& format, double tau_s);

  // Measures kFrames consecutive planes, `period_s` apart. Thread: one at a time.
  GapFigures measure(std::span<const void* const> planes, double period_s);

 private:
  struct Pair {
    int early;
    int late;
    double change;  // of the squared velocities that blurred the two frames, px^2
  };
  struct Sample {  // sums of products over a window of the picture, of one pair
    std::size_t window;
    double count, qa, qb, aa, ab, bb;
    double left(double rho) const { return (aa - 2.0 * rho * ab + rho * rho * bb) / count; }
  };

  void load(int frame, motion::PaddedPlane& to) const;
  void innovate(int frame, motion::Pyramid& to);
  void follow();
  std::vector<Pair> choose() const;
  void add(int frame, const motion::Affine& by, float share, motion::PaddedPlane& to);
  void take_own_blur(const Pair& pair);
  void compare(const Pair& pair);
  void sum_up(const Region& part, std::size_t window);
  void regress(GapFigures& figures);

  StreamTask task_;
  double tau_s_;
  const motion::Kernels& kernels_;
  motion::GlobalMotion global_;
  motion::Inertia inertia_{1.0};  // of the burst, like the next four
  std::span<const void* const> planes_;
  double noise_ = 0.0;                         // in the values' unit
  std::array<motion::Affine, kFrames> moved_;  // from the frame before
  std::vector<Sample> samples_;
  std::array<motion::PaddedPlane, 3> work_;
  motion::PaddedPlane a_, b_, q_, z_;
  std::array<motion::Pyramid, 2> pyramids_;
  motion::VectorField field_;
};

}  // namespace bolo::deblur

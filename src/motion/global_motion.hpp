// The motion of the whole picture from one innovation to the next: an affine field of displacements.
#pragma once

#include <array>
#include <span>
#include <vector>

#include "src/core/crew.hpp"
#include "src/core/frame.hpp"
#include "src/motion/block_field.hpp"
#include "src/motion/innovation.hpp"
#include "src/motion/kernels.hpp"

namespace bolo::motion {

// Displacement (px a frame) at column x and row y, counted from the frame's centre in halves of its width:
// (p0 + p1 x + p2 y, p3 + p4 x + p5 y).
struct Affine {
  std::array<double, 6> p{};

  Vec2 at(double x, double y) const noexcept {
    return {static_cast<float>(p[0] + p[1] * x + p[2] * y), static_cast<float>(p[3] + p[4] * x + p[5] * y)};
  }
  Affine operator+(const Affine& o) const noexcept;
  Affine operator*(double k) const noexcept;
};

// Centre of a block of `scale` times 8 pixels, in the coordinates of Affine::at(). Thread: any.
struct Centre {
  double x;
  double y;
};
inline Centre centre_of(Geometry frame, int scale, int column, int row) noexcept {
  const double half = 0.5 * frame.width;
  const double per_half = 1.0 / half;
  return {((column + 0.5) * kBlock * scale - half) * per_half,
          ((row + 0.5) * kBlock * scale - 0.5 * frame.height) * per_half};
}

// The field at the centres of blocks of `scale` times 8 pixels, in pixels of the pyramid's level of that scale.
void spread(const Affine& motion, Geometry frame, int scale, VectorField& out) noexcept;

struct Equations;

class GlobalMotion {
 public:
  // Thread: setup.
  explicit GlobalMotion(Geometry geometry);

  // The motion from `a` to `b`, stateless. `noise`: a frame's sigma in the values' unit. No allocation.
  // Thread: pipeline.
  Affine find(const Kernels& kernels, const Inertia& inertia, const Pyramid& a, const Pyramid& b, double noise,
              Crew& crew) noexcept;

  // Standard deviation, px, of the last find()'s displacement at the centre due to noise alone. Thread: pipeline.
  double uncertainty() const noexcept { return uncertainty_; }

  // Residual displacement, px, of the median block in the last find(): above a few, scenes differ. Thread: pipeline.
  double misfit() const noexcept { return misfit_; }

 private:
  struct Level {
    VectorField displacement;
    BlockField<MatchSums> sums;
    VectorField pull;  // bias of the sums by noise; only at full size
  };
  // Aperture problem: a scene whose edges are all parallel does not show its motion along them; the estimate there is
  // chance, and removed. Two directions, and the share of each that is unobservable at the coarsest level, 0 to 1.
  struct Unseen {
    struct Axis {
      double x = 0.0;
      double y = 0.0;
      double share = 0.0;
    };
    std::array<Axis, 2> axes;

    // From sums of the gradients' products, relative to those of noise alone; `chance`: uncertainty of these.
    void find(double xx, double xy, double yy, double chance) noexcept;
    void forget(Affine& motion) const noexcept;
  };
  // A whole displacement of the smallest level, and its mean difference.
  struct Start {
    float error = 0.0F;
    int x = 0;
    int y = 0;
  };
  static constexpr std::size_t kStarts = 4;

  std::span<const Start> search(const Kernels& kernels, const Pyramid& a, const Pyramid& b, Crew& crew,
                                std::array<Start, kStarts>& found) const noexcept;
  Affine refined(const Kernels& kernels, const Pyramid& a, const Pyramid& b, Start start) const noexcept;
  Affine start(const Kernels& kernels, const Inertia& inertia, const Pyramid& a, const Pyramid& b, double noise,
               Crew& crew) noexcept;
  Equations equations(int level, float typical, double variance) const noexcept;
  std::array<double, 2> gradients_of_noise(const Equations& sums, int level, double innovation_noise) const noexcept;
  void find_unseen(const Equations& sums, int level, std::array<double, 2> of_noise) noexcept;
  bool improve(const Kernels& kernels, const Inertia& inertia, const Pyramid& a, const Pyramid& b, int level,
               bool affine, double noise, Crew& crew, Affine& motion) noexcept;
  float typical_error(const Level& level) noexcept;

  Geometry geometry_;
  std::vector<Level> levels_;
  std::vector<float> errors_;
  Unseen unseen_;
  float typical_ = 0.0F;  // error of the last improve()
  double uncertainty_ = 0.0;
  double misfit_ = 0.0;
};

}  // namespace bolo::motion

// The sharp picture: each pixel estimated from the frame, the past moved onto it and the pixel's own past, checked
// against the innovation, and blended with a per-pixel estimate where that is better.
#pragma once

#include <array>
#include <memory>
#include <span>

#include "src/core/crew.hpp"
#include "src/motion/block_field.hpp"
#include "src/motion/innovation.hpp"
#include "src/motion/kernels.hpp"
#include "src/motion/path.hpp"
#include "src/motion/path_weights.hpp"
#include "src/motion/weights.hpp"

namespace bolo::motion {

struct EstimateInputs {
  const PaddedPlane* now = nullptr;              // all extended
  const PaddedPlane* innovation = nullptr;       // of this frame
  std::array<const PaddedPlane*, kPast> past{};  // 1, 2 ... frames before; null: lost (the first is then extrapolated)
  const PaddedPlane* ahead = nullptr;            // the frame after; null without look-ahead
  Path path;
  int bridged = 0;                         // lost frames across which the newest displacement was found
  const VectorField* deviation = nullptr;  // of the blocks from the path, px a frame
  const ScalarField* misfit = nullptr;     // of the blocks' displacements (local_motion.hpp); null: ignored
  double noise = 0.0;                      // standard deviation, in the values' unit
  // Delay of the middle of each row of blocks after the frame's time, periods; empty: none.
  std::span<const float> row_delay{};
  // The per-pixel estimate of the whole frame and its mean square error by block, in units of the noise's variance.
  const float* other = nullptr;
  const float* other_error = nullptr;
};

class Estimator {
 public:
  // `ahead`: 1 with one frame of look-ahead. Thread: setup.
  Estimator(Geometry geometry, const Inertia& inertia, int ahead);

  // Into `out`, a plane of the frame's size. No allocation. Thread: pipeline.
  void find(const Kernels& kernels, const EstimateInputs& in, Crew& crew, float* out) noexcept;

  // Share of the estimate along the motion in each block, 0 to 1, in the last find(). Thread: pipeline.
  const ScalarField& confidence() const noexcept { return share_; }

 private:
  struct PastRows {
    std::array<const PaddedPlane*, kPast> planes{};
    std::array<const Vec2*, kPast> displacements{};
  };

  void compare_paths(const EstimateInputs& in, int row) noexcept;
  void make_path_weights(const Kernels& kernels, const EstimateInputs& in, Crew& crew) noexcept;
  void set_fields(const EstimateInputs& in, std::span<const Affine, kPast> ways, int row) noexcept;
  void extend_row(int row, PaddedPlane& plane) const noexcept;
  int past_of(const EstimateInputs& in, std::size_t begin, std::size_t end, int row, PastRows& rows) const noexcept;
  void align_past(const Kernels& kernels, const EstimateInputs& in, Crew& crew) noexcept;
  float blur(const Kernels& kernels, const EstimateInputs& in) const noexcept;
  void choose_weights(const Kernels& kernels, const EstimateInputs& in, Crew& crew) noexcept;
  Columns next_columns(int row, int begin) const noexcept;
  float noise_of_difference() const noexcept;
  float usual_difference() noexcept;
  void add_far_past(const Kernels& kernels, const EstimateInputs& in, Crew& crew) noexcept;
  void check(const Kernels& kernels, const EstimateInputs& in, Crew& crew) noexcept;
  void copy_from_inside(int row) noexcept;
  void judge(const EstimateInputs& in, int row) noexcept;
  void protect_resting_blocks(const EstimateInputs& in, int row) noexcept;
  bool seen_before(int block) const noexcept;
  const PaddedPlane& at_frame_time(const Kernels& kernels, const EstimateInputs& in, Crew& crew) noexcept;
  template <typename T>
  std::array<const T*, 3> rows_around(const BlockField<T>& field, int row) const noexcept;

  Geometry geometry_;
  Inertia inertia_;
  std::shared_ptr<const WeightTable> table_;
  PathWeights path_weights_;
  PaddedPlane mean_;
  PaddedPlane far_;  // the far past's mean, then its difference from the near past's
  PaddedPlane ahead_;
  PaddedPlane along_;  // before smoothing across
  PaddedPlane x_;
  PaddedPlane left_;
  std::array<VectorField, kPast> past_;
  VectorField next_;
  VectorField tap_step_;  // from one tap of the estimate to the next
  VectorField trail_;
  VectorField direction_;
  ScalarField speed_;
  ScalarField lag_;
  BlockField<FitSums> fit_;
  BlockField<FilterWeights> weights_;
  BlockField<AcrossWeights> across_;
  BlockField<WeightTable::Place> place_;
  std::array<ScalarField, 4> raw_;
  std::array<ScalarField, 4> smooth_;
  ScalarField contrast_across_;  // noise variances
  ScalarField far_gain_;         // weight of the far past
  ScalarField far_share_;
  ScalarField bent_;         // share of the path's weights
  ScalarField unexplained_;  // mean square error that no weights can remove, noise variances
  BlockField<char> leaves_;  // 1: a trail leaves the picture
  ScalarField apart_;        // mean square difference of both estimates
  ScalarField step_;         // share of the residual that is added back
  ScalarField share_;
  ScalarField most_;  // largest share of any pixel of a block
};

}  // namespace bolo::motion

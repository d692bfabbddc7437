// Deblurring along the motion of the scene, which is estimated from the frames themselves (src/motion).
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <vector>

#include "src/deblur/mmae_solver.hpp"
#include "src/deblur/solver.hpp"
#include "src/motion/after_cut.hpp"
#include "src/motion/block_motion.hpp"
#include "src/motion/defects.hpp"
#include "src/motion/estimate.hpp"
#include "src/motion/global_motion.hpp"
#include "src/motion/gyro_motion.hpp"
#include "src/motion/innovation.hpp"
#include "src/motion/local_motion.hpp"

namespace bolo::deblur {

// prepare() estimates the whole frame; solve() copies it. mmae's estimate replaces it pixel by pixel where the motion
// does not explain the frames, and for whole frames without a motion: too many frames before are lost
// (MotionSolver::bridge), or the picture is too small.
//
// The memory of earlier windows holds only values that this window would give again: each displacement is that of three
// frames, all of them in the window (and, where it is measured, the noise, as in mmae).
class MotionSolver final : public Solver {
 public:
  explicit MotionSolver(const StreamTask& task);

  void prepare(const WindowView& window, Crew& crew) noexcept override;
  void solve(const WindowView& window, const Region& part, void* out) const noexcept override;
  void solve_points(const WindowView& window, std::span<const std::uint32_t> pixels, void* out) const noexcept override;
  int iterations() const noexcept override { return 1; }
  std::string_view isa() const noexcept override { return mmae_.isa(); }
  double noise_k() const noexcept override;
  double measured_noise_k() const noexcept override;
  const SceneMotion* motion() const noexcept override { return tells_motion_ ? &block_motions_.found() : nullptr; }
  std::optional<GyroUse> gyro_use() const noexcept override { return gyro_use_; }

 private:
  static constexpr int kFrames = motion::kPast + 2;  // of an estimate, including the one after it
  static constexpr int kBridge = 5;                  // frames before two lost ones from which these are extrapolated
  static constexpr int kFirst = motion::kHistory + 3 + kBridge;  // the newest frames, from which the path is computed
  struct Frame {
    bool there = false;
    bool lost = false;  // there, but extrapolated from the frames before
    motion::PaddedPlane values;
  };
  struct Innovation {
    bool there = false;
    motion::PaddedPlane values;
    motion::Pyramid smoothed;
  };
  struct Displacement {
    bool there = false;
    int bridged = 0;  // lost frames before or between its own: too uncertain for later paths, and not published
    motion::Affine motion;
    motion::Affine beyond;  // part of the displacement found that the extrapolated frame's error explains
    double uncertainty = 0.0;
    double misfit = 0.0;
    bool cut = false;  // by comparison with the displacements before
  };

  bool usable() const noexcept;
  Geometry followed() const noexcept;
  void forget() noexcept;
  void take(const void* plane, Crew& crew) noexcept;
  void load(const void* plane, Crew& crew, motion::PaddedPlane& to) const noexcept;
  bool bridge(Crew& crew) noexcept;
  bool find_path(const FrameMeta& meta, motion::Path& path, bool& ahead) noexcept;
  bool is_found(int back) noexcept;
  double cut_bound(int from, int to) noexcept;
  bool is_cut(int at, int newest) noexcept;
  int scene_length(int newest) noexcept;
  int known_before(int newest) noexcept;
  motion::Displacements history(int newest, const motion::GyroMotions& by_gyro, bool bridged = false) noexcept;
  bool use_gyro(const FrameMeta& meta, int newest, motion::Displacements& left, motion::GyroMotions& by_gyro) noexcept;
  const motion::VectorField& deviations(const motion::Affine& whole, Crew& crew) noexcept;
  void estimate_along_motion(const motion::Path& path, bool ahead, const motion::VectorField& deviation,
                             Crew& crew) noexcept;
  void without_old_scene(int newest, motion::EstimateInputs& in, Crew& crew) noexcept;
  void without_defects(bool fill) noexcept;
  void use_rest(int rests, const motion::VectorField& deviation) noexcept;
  void write(std::size_t pixel, std::size_t count, std::size_t to, void* out) const noexcept;
  void solve_per_pixel(const WindowView& window, Crew& crew) noexcept;
  // `back`: periods before the newest.
  Frame& frame(int back) noexcept { return frames_[place(back, frames_.size())]; }
  Innovation& innovation(int back) noexcept { return innovations_[place(back, innovations_.size())]; }
  Displacement& displacement(int back) noexcept { return displacements_[place(back, displacements_.size())]; }
  std::size_t place(int back, std::size_t size) const noexcept {
    return static_cast<std::size_t>(taken_ + size * 4 - static_cast<std::uint64_t>(back)) % size;
  }

  StreamTask task_;
  MmaeSolver mmae_;
  const motion::Kernels& kernels_;
  motion::Inertia inertia_;
  motion::GlobalMotion global_;
  motion::GyroMotion gyro_;
  std::optional<GyroUse> gyro_use_;
  motion::LocalMotion local_;
  std::vector<motion::Estimator> estimators_;  // without look-ahead, and with it
  std::array<Frame, kFrames> frames_;
  std::vector<Innovation> innovations_;
  std::array<Displacement, motion::kHistory + 1> displacements_;
  motion::AfterCut after_cut_;
  motion::VectorField field_;
  motion::BlockMotions block_motions_;
  motion::Defects defects_;
  std::vector<float> covered_;    // saved values of defects, by plane
  bool tells_motion_ = false;     // in the last prepare()
  std::uint64_t taken_ = 0;       // periods taken in
  std::uint64_t newest_ = 0;      // WindowView::newest of the last period; 0: none
  std::vector<float> row_delay_;  // of the middle of each row of blocks; empty: none
  std::vector<float> per_pixel_;
  std::vector<float> per_pixel_error_;
  std::vector<float> estimate_;
};

}  // namespace bolo::deblur

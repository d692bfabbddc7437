// Motion of blocks of 8 x 8 pixels beyond that of the whole picture.
#pragma once

#include <array>
#include <optional>

#include "src/core/crew.hpp"
#include "src/motion/block_field.hpp"
#include "src/motion/innovation.hpp"
#include "src/motion/kernels.hpp"

namespace bolo::motion {

class LocalMotion {
 public:
  // Thread: setup.
  explicit LocalMotion(Geometry geometry);

  // Deviations of the blocks' displacements from `global`, from the two innovations alone. Blocks that follow the
  // picture may deviate a little; where that fails, larger deviations are searched. `share`: factor from the deviations
  // found to the true ones. No allocation. Thread: pipeline.
  const VectorField& find(const Kernels& kernels, const Inertia& inertia, const Pyramid& a, const Pyramid& b,
                          const VectorField& global, double noise, float cap, float share, Crew& crew) noexcept;

  // Mean square residual of the found motion over 24 x 24 pixels, relative to that of noise and 1.3 times the texture's
  // energy: well above 1 where the two innovations are unrelated. Of the last find(). Thread: pipeline.
  const ScalarField& misfit() const noexcept { return misfit_; }
  // Sums of the last match, one step before the found motion. Of the last find(). Thread: pipeline.
  const BlockField<MatchSums>& sums() const noexcept { return sums_; }

 private:
  struct Task;
  float spread_of_deviations(const Task& task) const noexcept;
  void match_row(const Task& task, int row) noexcept;
  void step_row(const Task& task, const VectorField& base, float looseness, int row) noexcept;
  void mean_of_near(int row) noexcept;
  void refine(const Task& task, const VectorField& base, std::optional<float> looseness) noexcept;
  void cost_row(const Task& task, const VectorField& d, int row) noexcept;
  void costs(const Task& task, const VectorField& d, ScalarField& out) noexcept;
  void find_poor(const Task& task) noexcept;
  void search(const Task& task) noexcept;
  void choose(const Task& task) noexcept;

  VectorField total_;
  VectorField small_;  // near the global motion
  VectorField large_;  // anywhere
  VectorField found_;
  VectorField unsmoothed_;
  VectorField offered_;
  VectorField pull_;  // bias of the sums by noise
  BlockField<MatchSums> sums_;
  std::array<ScalarField, 6> mean_;
  std::array<ScalarField, 6> raw_;
  ScalarField cost_small_;
  ScalarField cost_large_;
  ScalarField cost_now_;
  ScalarField energy_;
  ScalarField misfit_;
  BlockField<unsigned char> poor_;
  BlockField<unsigned char> taken_;
};

}  // namespace bolo::motion

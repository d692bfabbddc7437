// Multiple-model adaptive estimation: every pixel is filtered in time with weights for the motion around it.
#pragma once

#include "src/deblur/motion_posterior.hpp"
#include "src/deblur/solver.hpp"

namespace bolo::deblur {

// Each block of 8 x 8 pixels weights the models by how well they explain its samples (MotionPosterior). Its filter is
// the mean, so weighted, of the models' best linear unbiased filters, interpolated between block centres. Other pixels
// affect the weights, but no other pixel's value enters an estimate: nothing is smoothed in space.
class MmaeSolver final : public Solver {
 public:
  explicit MmaeSolver(const StreamTask& task);

  void prepare(const WindowView& window, Crew& crew) noexcept override;
  void solve(const WindowView& window, const Region& part, void* out) const noexcept override;
  void solve_points(const WindowView& window, std::span<const std::uint32_t> pixels, void* out) const noexcept override;
  // As solve(); also the expected mean square errors of the estimate, in units of the noise's variance, of the blocks
  // of 8 x 8 pixels whose first row is in `part`: errors[row of blocks * blocks across + column].
  void solve(const WindowView& window, const Region& part, void* out, float* errors) const noexcept;
  int iterations() const noexcept override { return 1; }
  std::string_view isa() const noexcept override { return kernels().isa; }
  const MmaeKernels& kernels() const noexcept { return posterior_.kernels(); }
  double noise() const noexcept { return posterior_.noise(); }  // in the values' unit
  double measured_noise() const noexcept { return posterior_.measured_noise(); }
  double noise_k() const noexcept override;
  bool set_noise(double noise_k) noexcept override;
  double measured_noise_k() const noexcept override;

 private:
  struct Columns;
  void solve_columns(const WindowView& window, const Region& part, std::byte* out, std::size_t stride,
                     float* errors) const noexcept;
  void filter_row(const WindowView& window, std::size_t pixel, FilterRow& row, const BlockWeights& above,
                  const BlockWeights& below) const noexcept;
  void find_weights(const WindowView& window, int block_row, const Columns& columns,
                    BlockWeights& weights) const noexcept;

  StreamTask task_;
  MotionPosterior posterior_;
};

}  // namespace bolo::deblur

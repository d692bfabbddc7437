// Posterior probabilities of the motion models for each block of 8 x 8 pixels of a window.
#pragma once

#include <vector>

#include "src/core/crew.hpp"
#include "src/deblur/mmae_kernels.hpp"
#include "src/deblur/motion_models.hpp"
#include "src/deblur/noise_meter.hpp"
#include "src/deblur/settings.hpp"

namespace bolo::deblur {

class MotionPosterior {
 public:
  // The models' estimates are at the frame's time, for the rows in the middle of each row of blocks: tables().weights
  // has one entry for each row of blocks, or one for all where rows are sampled together. Thread: setup.
  explicit MotionPosterior(const StreamTask& task);

  // Measures the noise and prepares for the pattern of lost frames: windows with at most one lost frame are prepared in
  // advance, others cost some 0.5 ms when their pattern changes. No allocation. Thread: pipeline.
  void prepare(const WindowView& window, const Pattern& pattern, Crew& crew) noexcept;

  // Posteriors of `count` blocks (up to kStatBlocks) from `first` on, each independent of the others. Thread: worker.
  void find(const WindowView& window, int block_row, int first, int count, Posteriors& out) const noexcept;

  const MotionModels& models() const noexcept { return models_; }
  const ModelTables& tables() const noexcept { return tables_[current_]; }
  const MmaeKernels& kernels() const noexcept { return kernels_; }
  int blocks_across() const noexcept { return (geometry_.width + kStatBlock - 1) / kStatBlock; }
  int blocks_down() const noexcept { return (geometry_.height + kStatBlock - 1) / kStatBlock; }
  // Index in tables().weights for a row of blocks. Thread: any.
  int weights_of(int block_row) const noexcept { return delays_rows_ ? block_row : 0; }
  double noise() const noexcept { return noise_.noise(); }  // in the values' unit
  double measured_noise() const noexcept { return noise_.measured(); }
  void set_noise(double noise_k) noexcept { noise_.set(noise_k); }

 private:
  std::size_t place_of(const Pattern& pattern) noexcept;
  void point_at_planes(const WindowView& window, std::size_t first, std::size_t stride,
                       BlockSamples& samples) const noexcept;

  Geometry geometry_;
  PixelType type_;
  bool delays_rows_;
  MotionModels models_;
  NoiseMeter noise_;
  const MmaeKernels& kernels_;
  std::vector<ModelTables> tables_;  // the first kept_ stay, the others are reused in turn
  std::size_t kept_ = 0;
  std::size_t next_ = 0;
  std::size_t current_ = 0;
};

}  // namespace bolo::deblur

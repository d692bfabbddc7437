// A plane of floats with a rim around it, so that kernels may read beyond the frame.
#pragma once

#include <algorithm>
#include <cstddef>
#include <vector>

#include "src/core/frame.hpp"
#include "src/core/scene_motion.hpp"

namespace bolo::motion {

inline constexpr int kBlock = kMotionBlock;  // pixels a side of a block with one motion
inline constexpr int kRim = 16;  // at least two blocks: a displaced block of 12 x 12 never leaves it (block-inl.hpp)

constexpr int blocks_over(int pixels) { return motion_blocks(pixels); }

struct RowRange {
  int begin;
  int end;
};

// Coordinates count from the frame's first pixel; readable from -kRim to whole blocks + kRim.
class PaddedPlane {
 public:
  PaddedPlane() = default;
  explicit PaddedPlane(Geometry geometry)
      : geometry_(geometry),
        stride_(static_cast<std::size_t>(blocks_over(geometry.width) * kBlock + 2 * kRim)),
        values_(stride_ * static_cast<std::size_t>(blocks_over(geometry.height) * kBlock + 2 * kRim)) {}

  Geometry geometry() const noexcept { return geometry_; }
  int blocks_across() const noexcept { return blocks_over(geometry_.width); }
  int blocks_down() const noexcept { return blocks_over(geometry_.height); }
  // The frame's rows [begin, end) of a row of blocks.
  RowRange rows_of(int block_row) const noexcept {
    return {block_row * kBlock, std::min((block_row + 1) * kBlock, geometry_.height)};
  }
  std::ptrdiff_t stride() const noexcept { return static_cast<std::ptrdiff_t>(stride_); }
  float* at(int x, int y) noexcept { return values_.data() + offset(x, y); }
  const float* at(int x, int y) const noexcept { return values_.data() + offset(x, y); }

  void fill(float value) noexcept { std::ranges::fill(values_, value); }
  // Repeats the border beside rows [begin, end), and above or below the frame if they hold its first or last.
  // Thread: worker.
  void extend(int begin, int end) noexcept;
  void extend() noexcept { extend(0, geometry_.height); }
  // Reflects the inside about the border's value, so that gradients continue; first the rows' sides, then, from whole
  // rows, above and below. Thread: worker.
  void mirror_sides(int begin, int end) noexcept;
  void mirror_ends() noexcept;

 private:
  float* row(int y) noexcept { return at(-kRim, y); }
  int end_row() const noexcept { return blocks_down() * kBlock + kRim; }
  std::size_t offset(int x, int y) const noexcept {
    return static_cast<std::size_t>(y + kRim) * stride_ + static_cast<std::size_t>(x + kRim);
  }

  Geometry geometry_{};
  std::size_t stride_ = 0;
  std::vector<float> values_;
};

}  // namespace bolo::motion

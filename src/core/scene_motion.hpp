// Motion of the scene through the picture from the frame before to a frame.
#pragma once

#include <array>
#include <vector>

#include "src/core/frame.hpp"

namespace bolo {

inline constexpr int kMotionBlock = 8;  // px a side

// Blocks that cover so many pixels.
constexpr int motion_blocks(int pixels) { return (pixels + kMotionBlock - 1) / kMotionBlock; }
constexpr Geometry motion_blocks(Geometry frame) { return {motion_blocks(frame.width), motion_blocks(frame.height)}; }

// One block's motion: px a frame, to the right and down; confidence from 0, unknown, to 1.
struct BlockMotion {
  float x = 0.0F;
  float y = 0.0F;
  float confidence = 0.0F;
};
inline constexpr std::size_t kMotionValues = sizeof(BlockMotion) / sizeof(float);

struct SceneMotion {
  SceneMotion() = default;
  explicit SceneMotion(Geometry frame) : size(motion_blocks(frame)), blocks(size.pixels()) {}

  Geometry size;  // blocks across and down
  // Of the whole picture, px a frame: (a0 + a1 X + a2 Y, a3 + a4 X + a5 Y) at X columns and Y rows from its centre.
  std::array<double, 6> affine{};
  std::vector<BlockMotion> blocks;  // row-major
};

}  // namespace bolo

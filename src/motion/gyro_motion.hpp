// The picture's motion from a gyro, over the frames of a path.
#pragma once

#include <array>
#include <cstdint>
#include <span>

#include "src/core/frame.hpp"
#include "src/core/gyro.hpp"
#include "src/motion/path.hpp"

namespace bolo::motion {

class GyroMotion {
 public:
  // Thread: setup.
  GyroMotion(Geometry frame, int row_step, const GyroSetup& setup, double period_s, const Inertia& inertia);

  // The motion before `time_ns`, the time of the newest displacement. False if the samples do not cover it: late by
  // more than half a frame, begun after it, or with gaps of more than three frames. Thread: pipeline.
  bool find(std::span<const GyroSample> samples, std::int64_t time_ns, GyroMotions& out) const noexcept;

 private:
  static constexpr int kPartsOfFrame = 4;
  Affine motion_of(const std::array<double, 3>& turn) const noexcept;

  Geometry frame_;
  double row_step_;
  GyroSetup setup_;
  double period_ns_;
  std::array<double, kPartsOfFrame + 1> weights_{};  // of the innovation's parts, newest first
};

}  // namespace bolo::motion

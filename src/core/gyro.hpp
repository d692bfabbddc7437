// A gyro beside the camera, and how its turning shows in the picture.
#pragma once

#include <array>
#include <cmath>
#include <cstdint>
#include <span>
#include <string_view>

#include "src/core/frame.hpp"

namespace bolo {

// Rates are about the camera's axes: x to the right, y down, z into the picture; a camera that turns to the right turns
// about y by a positive angle.
struct GyroSample {
  std::int64_t time_ns = 0;
  std::array<double, 3> rate{};  // rad/s
};

inline constexpr double kFastestTurn = 100.0;  // rad/s; what is more, or no number, is no rate. Thread: any.
inline bool is_turn(const std::array<double, 3>& rate) noexcept {
  return std::abs(rate[0]) <= kFastestTurn && std::abs(rate[1]) <= kFastestTurn && std::abs(rate[2]) <= kFastestTurn;
}

class Gyro {
 public:
  virtual ~Gyro() = default;
  // The samples so far, times strictly rising, all is_turn(); good until the next call. No allocation, no lock.
  // Thread: pipeline.
  virtual std::span<const GyroSample> samples() noexcept = 0;
  // When a frame was taken, on the samples' clock. Thread: any.
  virtual std::int64_t time_of(const FrameMeta& frame) const noexcept = 0;
};

// A camera's lens, in pixels of its frames, and its gyro (camera profile).
struct GyroSetup {
  double focal_px = 0.0;  // 0: not known
  double principal_x_px = 0.0;
  double principal_y_px = 0.0;  // from the frame's centre, to the right and down
  double delay_s = 0.0;         // by which samples are stamped later than frames of the same moment
};

// Use of the gyro in a frame.
enum class GyroUse : std::uint8_t {
  kUsed,
  kSilent,   // no samples of the frame's time
  kIgnored,  // they do not go with the picture
};
inline constexpr std::size_t kGyroUses = 3;
constexpr std::string_view name(GyroUse use) {
  constexpr std::array<std::string_view, kGyroUses> kNames{"used", "silent", "ignored"};
  return kNames[static_cast<std::size_t>(use)];
}

}  // namespace bolo

// A gyro beside the camera: samples, source, setup and use.
#pragma once

#include <array>
#include <cmath>
#include <cstdint>
#include <span>
#include <string_view>

#include "src/core/frame.hpp"

namespace bolo {

// Rates are about the camera's axes: x to the right, y down, z into the picture; turning right is positive about y.
struct GyroSample {
  std::int64_t time_ns = 0;
  std::array<double, 3> rate{};  // rad/s
};

inline constexpr double kFastestTurn = 100.0;  // rad/s; larger values and NaN are not valid rates. Thread: any.
inline bool is_turn(const std::array<double, 3>& rate) noexcept {
  return std::abs(rate[0]) <= kFastestTurn && std::abs(rate[1]) <= kFastestTurn && std::abs(rate[2]) <= kFastestTurn;
}

class Gyro {
 public:
  virtual ~Gyro() = default;
  // All samples so far, strictly rising, all is_turn(); valid until the next call. No allocation, no lock.
  // Thread: pipeline.
  virtual std::span<const GyroSample> samples() noexcept = 0;
  // Time of a frame on the samples' clock. Thread: any.
  virtual std::int64_t time_of(const FrameMeta& frame) const noexcept = 0;
};

// Lens, in pixels of the frames, and gyro of a camera (camera profile).
struct GyroSetup {
  double focal_px = 0.0;  // 0: not known
  double principal_x_px = 0.0;
  double principal_y_px = 0.0;  // from the frame's centre, to the right and down
  double delay_s = 0.0;         // samples are stamped this much later than frames of the same moment
};

enum class GyroUse : std::uint8_t {
  kUsed,
  kSilent,   // no samples for the frame's time
  kIgnored,  // samples that contradict the picture's motion
};
inline constexpr std::size_t kGyroUses = 3;
constexpr std::string_view name(GyroUse use) {
  constexpr std::array<std::string_view, kGyroUses> kNames{"used", "silent", "ignored"};
  return kNames[static_cast<std::size_t>(use)];
}

}  // namespace bolo

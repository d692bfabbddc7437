// The frame period by the camera's own clock, whatever its settings say.
#pragma once

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>

#include "src/core/clock.hpp"

namespace bolo::genicam {

// The median of 32 steps of the clock, each over the frames that the counter says it took: pauses and lost frames do
// not move it. Thread: acquire. No allocation.
class PeriodMeter {
 public:
  // Another connection's frames follow, or the clock jumped.
  void restart() noexcept { started_ = false; }

  // s; 0 unless this frame completed a measurement.
  double add(std::uint64_t frame_id, std::int64_t camera_ns) noexcept {
    const bool follows = started_ && frame_id > last_id_ && camera_ns > last_ns_;
    if (follows) {
      steps_ns_[count_++] = static_cast<double>(camera_ns - last_ns_) / static_cast<double>(frame_id - last_id_);
    } else {
      count_ = 0;
    }
    started_ = true;
    last_id_ = frame_id;
    last_ns_ = camera_ns;
    if (count_ < steps_ns_.size()) return 0.0;
    count_ = 0;
    const auto middle = steps_ns_.begin() + steps_ns_.size() / 2;
    std::nth_element(steps_ns_.begin(), middle, steps_ns_.end());
    return *middle / kNsPerSecond;
  }

 private:
  std::array<double, 32> steps_ns_{};
  std::size_t count_ = 0;
  bool started_ = false;
  std::uint64_t last_id_ = 0;
  std::int64_t last_ns_ = 0;
};

}  // namespace bolo::genicam

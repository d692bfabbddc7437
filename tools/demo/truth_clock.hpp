// Which frame of a capture a live frame is, when a fake camera replays the capture again and again.
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <vector>

namespace bolo::tools {

class TruthClock {
 public:
  // `t`: the capture's times, s. At each lap the fake camera's clock goes on by the capture's span and one period.
  TruthClock(const std::vector<double>& t, double period_s);

  // The capture's frame that was sampled at camera_ns, or nothing when no frame lies within a quarter of a period.
  // Thread: any.
  std::optional<std::size_t> frame_at(std::int64_t camera_ns) const;

 private:
  std::vector<double> t_;  // from the first frame, s
  double period_s_;
  double first_s_;
  double lap_s_;
};

}  // namespace bolo::tools

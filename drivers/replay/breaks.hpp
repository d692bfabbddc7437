// Where a capture says that frames before and after do not belong together.
#pragma once

#include <algorithm>
#include <cstddef>
#include <vector>

#include "src/capture/capture.hpp"

namespace bolo::replay {

// The times of "nuc" and "reconnect" events, walked along with the frames. Thread: acquire.
class Breaks {
 public:
  explicit Breaks(const std::vector<capture::Event>& events) {
    for (const capture::Event& event : events) {
      if (event.kind == "nuc" || event.kind == "reconnect") times_s_.push_back(event.t_s);
    }
    std::sort(times_s_.begin(), times_s_.end());
  }

  // True when a break lies after the frame asked about before and not after this one at `t_s`. Ask in rising order.
  bool before(double t_s) {
    const std::size_t first = next_;
    while (next_ < times_s_.size() && times_s_[next_] <= t_s) ++next_;
    return next_ != first;
  }

 private:
  std::vector<double> times_s_;
  std::size_t next_ = 0;
};

}  // namespace bolo::replay

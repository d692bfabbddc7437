// Frame numbers and times that rise across the restarts of a daemon or a camera.
#pragma once

#include <cstdint>
#include <optional>

#include "src/core/frame.hpp"

namespace bolo::tools {

// A restarted daemon goes on with the camera's own counter and clock where the camera ran on; a restarted camera begins
// anew. What begins anew is shifted to where the host's clock says that it belongs. Thread: one at a time.
class RisingStream {
 public:
  explicit RisingStream(double frame_period_s) : frame_period_s_(frame_period_s) {}

  // The frame as it is to be recorded, its frame_id and camera_ns above those of all frames before. `restarted`: the
  // first one of a daemon that was started again.
  FrameMeta place(FrameMeta meta, bool restarted = false) noexcept;
  // True when the last frame placed began a new count.
  bool shifted() const noexcept { return shifted_; }

 private:
  bool continues(const FrameMeta& meta, bool restarted) const noexcept;

  double frame_period_s_;
  std::uint64_t id_shift_ = 0;  // modulo 2^64
  std::int64_t ns_shift_ = 0;
  std::optional<FrameMeta> last_;  // as placed
  bool shifted_ = false;
};

}  // namespace bolo::tools

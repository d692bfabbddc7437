// Metadata of a frame in the pipeline.
#pragma once

#include <cstdint>

namespace bolo {

// State of a frame, set by whoever learns it. The values are part of the shared-memory layout (shm_layout.h).
enum FrameFlag : std::uint32_t {
  kFlagNone = 0,
  kFlagGap = 1U << 0,        // at least one frame of this frame's window was lost
  kFlagWarmUp = 1U << 1,     // no full window reaches back yet: the deblurred plane is the raw one
  kFlagNuc = 1U << 2,        // the camera was correcting (shutter closed) while this frame was taken
  kFlagSaturated = 1U << 3,  // raw values at the end of the 16-bit range
  kFlagJitter = 1U << 4,     // the camera's timestamp is off the frame grid; bits 5 to 7: pipeline/quality_level.hpp
};

struct FrameMeta {
  std::uint64_t frame_id = 0;   // the camera's counter, unwrapped; a jump is a lost frame
  std::int64_t camera_ns = 0;   // the camera's clock
  std::int64_t receive_ns = 0;  // host CLOCK_MONOTONIC, when the frame's first byte arrived
  std::uint32_t flags = kFlagNone;
  std::int64_t host_ns =
      0;  // camera_ns on the host's CLOCK_MONOTONIC, as a watched camera's source estimates it; 0: not
  // Of host_ns, or of receive_ns where that is not known; the pipeline fills it in. ns since 1970; 0: not known.
  std::int64_t utc_ns = 0;
  std::int64_t utc_uncertainty_ns = 0;  // at most; see bolo_shm_slot
};

// When the frame was taken, on the host's CLOCK_MONOTONIC: where the camera's clock is not mapped, when it came.
// Thread: any.
inline std::int64_t host_time_ns(const FrameMeta& meta) noexcept {
  return meta.host_ns != 0 ? meta.host_ns : meta.receive_ns;
}

}  // namespace bolo

// A recording from a daemon's shared memory: frames are taken off the ring on the calling thread and written on
// another. The daemon doesn't know of it: its memory is mapped read-only.
#pragma once

#include <atomic>
#include <cstdint>
#include <functional>
#include <optional>
#include <string>

#include "src/core/frame.hpp"
#include "src/core/result.hpp"
#include "tools/record/file_writer.hpp"

namespace bolo::tools {

// Frame numbers and times that rise across the restarts of a daemon or a camera. A restarted daemon goes on with the
// camera's own counter and clock if the camera ran on; a restarted camera begins anew, and is shifted to its time on
// the host's clock. Thread: one at a time.
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

enum class RecordedPlane { kRaw, kDeblurred };

struct RecordRequest {
  std::string name;  // of the shared memory
  RecordedPlane plane = RecordedPlane::kRaw;
  std::uint64_t frames = 0;    // 0: no limit
  double seconds = 0.0;        // of the host's clock, from the first frame on; 0: no limit
  double wait_s = 30.0;        // for a daemon that went away
  bool wait_at_start = false;  // also for one that is not there yet
  FileWriterOptions writer;    // but for what the daemon tells: info, attributes, motion
};

struct RecordResult {
  FileWriterResult written;
  std::uint64_t lost_before = 0;       // jumps of the frame number: lost by camera, network or daemon
  std::uint64_t lost_overwritten = 0;  // the ring's writer was faster than this program
  std::uint64_t lost_no_room = 0;      // the disk was behind by the whole buffer
  std::uint64_t reconnects = 0;
  std::size_t buffer_frames = 0;
  bool complete = true;  // what was asked for is there
  Status status;         // why it ended early
};

// Records until what was asked for is there, `stop` is set, the daemon stays away, or writing fails. `progress` is
// called with the frames written, several times a second. An error means that nothing was begun; what happened later is
// in RecordResult::status. Thread: setup.
Result<RecordResult> record(const RecordRequest& request, const std::atomic<bool>& stop,
                            const std::function<void(std::uint64_t)>& progress);

}  // namespace bolo::tools

// Records from a daemon's shared memory: the calling thread takes frames from the ring, another one writes them. The
// daemon does not notice, because its memory is mapped read-only.
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

// Frame numbers and times that rise across restarts of daemon or camera. A restarted daemon continues the camera's own
// counter and clock if the camera kept running; a restarted camera counts anew, and is shifted to its time on the
// host's clock. Thread: one at a time.
class RisingStream {
 public:
  explicit RisingStream(double frame_period_s) : frame_period_s_(frame_period_s) {}

  // Raises frame_id and camera_ns above those of all frames before. `restarted`: first frame of a restarted daemon.
  FrameMeta place(FrameMeta meta, bool restarted = false) noexcept;
  // True if the last placed frame began a new count.
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
  double wait_s = 30.0;        // how long to wait for a daemon that went away
  bool wait_at_start = false;  // also wait for one that does not exist yet
  FileWriterOptions writer;    // without info, attributes and motion, which the daemon tells
};

struct RecordResult {
  FileWriterResult written;
  std::uint64_t lost_before = 0;       // jumps of the frame number: lost in camera, network or daemon
  std::uint64_t lost_overwritten = 0;  // the ring was overwritten faster than this program read it
  std::uint64_t lost_no_room = 0;      // the disk was behind by the whole buffer
  std::uint64_t reconnects = 0;
  std::size_t buffer_frames = 0;
  bool complete = true;  // everything requested was recorded
  Status status;         // the error that ended it early
};

// Records until all requested frames are there, `stop` is set, the daemon stays away, or writing fails. `progress` is
// called with the number of frames written, several times a second. Error: nothing was begun; later failures are in
// RecordResult::status. Thread: setup.
Result<RecordResult> record(const RecordRequest& request, const std::atomic<bool>& stop,
                            const std::function<void(std::uint64_t)>& progress);

}  // namespace bolo::tools

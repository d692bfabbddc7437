// A capture file as a source: in process, as fast as the pipeline takes it, or at the capture's own rate.
#pragma once

#include <atomic>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <memory>
#include <optional>
#include <thread>
#include <vector>

#include "src/capture/capture.hpp"
#include "src/core/frame.hpp"
#include "src/pipeline/source.hpp"

namespace bolo::replay {

// --- Part of a plane as a plane of its own.

// Copies `region` of a plane of geometry `whole` with values of `value_bytes` into `out`, row after row without gaps.
// The region lies inside. Thread: any.
inline void copy_region(const void* plane, Geometry whole, std::size_t value_bytes, const Region& region, void* out) {
  const std::size_t row_bytes = static_cast<std::size_t>(region.width) * value_bytes;
  const auto* from = static_cast<const std::byte*>(plane);
  auto* to = static_cast<std::byte*>(out);
  for (int y = region.y; y < region.y + region.height; ++y, to += row_bytes) {
    const auto first =
        static_cast<std::size_t>(y) * static_cast<std::size_t>(whole.width) + static_cast<std::size_t>(region.x);
    std::memcpy(to, from + first * value_bytes, row_bytes);
  }
}

enum class Pace {
  kAsFastAsPossible,  // waits for the pipeline: nothing is ever lost
  kRealTime,          // at the capture's times; what the pipeline can't take is lost and counted
};

enum class Laps {
  kOne,
  kForEver,  // from the first frame again after the last: numbers and times rise on, and a new window begins
};

// Frames carry the capture's frame_id, /t in ns as camera time, and the host's time now as receive time. A jump of the
// frame_id counts as that many frames missing. An event "nuc" or "reconnect" starts a new window with the first frame
// at or after it; frames missing there are no loss.
class ReplaySource final : public pipeline::FrameSource {
 public:
  // With `region` only these pixels of each frame are handed in, and the source's geometry is the region's. The reader
  // is used from the source's own thread between start() and stop().
  ReplaySource(std::shared_ptr<const capture::CaptureReader> reader, Pace pace, std::optional<Region> region = {},
               Laps laps = Laps::kOne);
  ~ReplaySource() override;

  Result<pipeline::SourceInfo> open() override;
  Status start(pipeline::FrameInlet& inlet) override;
  void stop() noexcept override;

  // Fails: there is no camera. Thread: any.
  Status trigger_nuc() override { return failed("a capture is replayed: there is no camera to correct"); }

  // A read error that ended the replay early, if any. Thread: setup, after stop().
  Status result() const { return result_; }

 private:
  struct Lap {
    std::uint64_t frames = 0;
    std::int64_t ns = 0;
  };
  Lap length() const;
  void feed(pipeline::FrameInlet& inlet);
  bool play(pipeline::FrameInlet& inlet, std::int64_t start_ns, Lap lap);
  bool sleep_until(std::int64_t due_ns) const noexcept;
  Status read(std::size_t index, std::byte* plane);

  std::shared_ptr<const capture::CaptureReader> reader_;
  Pace pace_;
  Laps laps_;
  Region region_;                      // the whole frame unless one was asked for
  std::vector<std::byte> full_frame_;  // empty when the region is the whole frame
  std::atomic<bool> stop_requested_{false};
  std::thread thread_;
  Status result_;
};

}  // namespace bolo::replay

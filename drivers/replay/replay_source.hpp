// Replays a capture file in process, as fast as the pipeline accepts frames or in real time.
#pragma once

#include <atomic>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <thread>
#include <vector>

#include "src/capture/capture.hpp"
#include "src/core/frame.hpp"
#include "src/pipeline/source.hpp"

namespace bolo::replay {

enum class Pace {
  kAsFastAsPossible,  // waits for the pipeline: no frame is lost
  kRealTime,          // at the capture's times; frames that the pipeline cannot take are lost and counted
};

enum class Laps {
  kOne,
  kForEver,  // restarts after the last frame: frame ids and times keep rising, and a new window begins
};

enum class Values {
  kAsStored,
  kCounts,  // 16 bits, as from a camera: float32 is rounded to 10 mK, or to whole counts if not in kelvin
};

enum class Repeats {
  kFrames,   // treated like other frames
  kDropped,  // the pipeline drops them: the period is that of the remaining frames
};

// Frames carry the capture's frame_id, /t in ns as camera time, and the current host time as receive time. A jump of
// the frame_id counts the skipped frames as missing. An event "nuc" or "reconnect" starts a new window with the first
// frame at or after it; frames missing there are not counted.
class ReplaySource final : public pipeline::FrameSource {
 public:
  // The reader is used by the source's thread between start() and stop().
  ReplaySource(std::shared_ptr<const capture::CaptureReader> reader, Pace pace, Laps laps = Laps::kOne,
               Values values = Values::kAsStored, Repeats repeats = Repeats::kFrames);
  ~ReplaySource() override;

  Result<pipeline::SourceInfo> open() override;
  Status start(pipeline::FrameInlet& inlet) override;
  void stop() noexcept override;

  // Fails: there is no camera. Thread: any.
  Status trigger_nuc() override { return failed("a capture is replayed: there is no camera to correct"); }

  // Read error that ended the replay early, if any. Thread: setup, after stop().
  Status result() const { return result_; }

 private:
  struct Lap {
    std::uint64_t frames = 0;
    std::int64_t ns = 0;
  };
  Lap length() const;
  bool rounds() const { return values_ == Values::kCounts && reader_->info().format.type == PixelType::kFloat32; }
  Status read(std::size_t index, void* out);
  void feed(pipeline::FrameInlet& inlet);
  bool play(pipeline::FrameInlet& inlet, std::int64_t start_ns, Lap lap);
  bool sleep_until(std::int64_t due_ns) const noexcept;

  std::shared_ptr<const capture::CaptureReader> reader_;
  Pace pace_;
  Laps laps_;
  Values values_;
  Repeats repeats_;
  std::vector<float> plane_;  // stored frame, before rounding
  std::atomic<bool> stop_requested_{false};
  std::thread thread_;
  Status result_;
};

}  // namespace bolo::replay

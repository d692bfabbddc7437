// A moving scene as a camera sees it, in memory, with its truth; and as a frame source.
#pragma once

#include <atomic>
#include <cstddef>
#include <cstdint>
#include <thread>
#include <vector>

#include "src/core/frame.hpp"
#include "src/core/result.hpp"
#include "src/pipeline/source.hpp"
#include "src/sim/simulator.hpp"

namespace bolo::tools {

// Frame k was taken k periods after the first.
struct Recording {
  StreamFormat format;
  std::vector<std::vector<std::byte>> planes;
  std::vector<std::vector<float>> truth;  // K
};

struct StreetPass {
  std::uint64_t street = 5;  // which street
  double speed_px_s = 60.0;
  std::size_t frames = 260;
  std::size_t more_frames = 32;  // later frames, for effects that lose frames or jitter
};

// Thread: any.
Result<Recording> record_street(const sim::CameraSettings& camera, const StreetPass& pass);

// Delivers every frame, as fast as they are consumed. Frame k has id k and a time of k periods.
class RecordingSource final : public pipeline::FrameSource {
 public:
  // The recording must outlive this. Thread: setup.
  explicit RecordingSource(const Recording& recording) : recording_(recording) {}
  ~RecordingSource() override { RecordingSource::stop(); }
  RecordingSource(const RecordingSource&) = delete;
  RecordingSource& operator=(const RecordingSource&) = delete;

  Result<pipeline::SourceInfo> open() override { return pipeline::SourceInfo{recording_.format, "recording", ""}; }
  Status start(pipeline::FrameInlet& inlet) override;
  void stop() noexcept override;

 private:
  void feed(pipeline::FrameInlet& inlet) noexcept;

  const Recording& recording_;
  std::atomic<bool> stop_{false};
  std::thread thread_;
};

}  // namespace bolo::tools

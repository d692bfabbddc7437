// A moving scene as seen by a camera, in memory with its truth, and as a source of frames.
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

// Frame k was taken k periods after frame 0.
struct Recording {
  StreamFormat format;
  std::vector<std::vector<std::byte>> planes;
  std::vector<std::vector<float>> truth;  // K
};

struct StreetPass {
  std::uint64_t street = 5;  // seed of the street
  double speed_px_s = 60.0;
  std::size_t frames = 260;
  std::size_t more_frames = 32;  // later frames for effects that lose or jitter frames
};

// Thread: any.
Result<Recording> record_street(const sim::CameraSettings& camera, const StreetPass& pass);

// Delivers every frame as fast as the pipeline takes them. Frame k has id k and the time of k periods.
class RecordingSource final : public pipeline::FrameSource {
 public:
  // The recording must outlive the source. Thread: setup.
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

// Interface of a source of frames: a camera, its fake, a capture.
#pragma once

#include <string>
#include <vector>

#include "src/core/plane.hpp"
#include "src/core/result.hpp"
#include "src/pipeline/inlet.hpp"
#include "src/pipeline/notices.hpp"
#include "src/pipeline/source_status.hpp"

namespace bolo::pipeline {

struct SourceInfo {
  StreamFormat format;
  std::string camera_model;
  std::string camera_serial;
};

class FrameSource {
 public:
  virtual ~FrameSource() = default;

  // Connects, configures, and returns the format of the frames. Called once. Thread: setup.
  virtual Result<SourceInfo> open() = 0;

  // Frames go into the inlet from now on, from one thread of the source's own; the inlet outlives stop(). Thread:
  // setup.
  virtual Status start(FrameInlet& inlet) = 0;

  // No frame is handed in after it returns. Idempotent. Thread: setup.
  virtual void stop() noexcept = 0;

  // Of a source that is monitored, as long as the source lives; null for others. Thread: any.
  virtual const SourceStatus* status() const noexcept { return nullptr; }

  // Events since the last call, newest last. Thread: any.
  virtual std::vector<Notice> take_notices() { return {}; }

  // Starts a NUC (non-uniformity correction). Blocks until the camera has taken the command. Thread: any.
  virtual Status trigger_nuc() { return failed("this source has no pixels to correct"); }
};

}  // namespace bolo::pipeline

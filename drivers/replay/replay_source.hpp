// A capture file as a source: in process, as fast as the pipeline takes it, or at the capture's own rate.
#pragma once

#include <atomic>
#include <memory>
#include <thread>

#include "bolo/capture/capture.hpp"
#include "bolo/pipeline/source.hpp"

namespace bolo::replay {

enum class Pace {
  kAsFastAsPossible,  // waits for the pipeline: nothing is ever lost
  kRealTime,          // at the capture's times; what the pipeline can't take is lost and counted
};

class ReplaySource final : public pipeline::FrameSource {
 public:
  ReplaySource(std::shared_ptr<const capture::CaptureReader> reader, Pace pace);
  ~ReplaySource() override;

  Result<pipeline::SourceInfo> open() override;
  Status start(pipeline::FrameInlet& inlet) override;
  void stop() noexcept override;

  // A read error that ended the replay early, if any. Thread: setup, after stop().
  Status result() const { return result_; }

 private:
  void feed(pipeline::FrameInlet& inlet);

  std::shared_ptr<const capture::CaptureReader> reader_;
  Pace pace_;
  std::atomic<bool> stop_requested_{false};
  std::thread thread_;
  Status result_;
};

}  // namespace bolo::replay

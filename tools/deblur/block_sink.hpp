// The sink of one block of a capture: its sharp planes, one after the other, in a plain file.
#pragma once

#include <atomic>
#include <cstdint>
#include <cstdio>
#include <filesystem>
#include <memory>

#include "drivers/replay/replay_source.hpp"
#include "src/pipeline/sink.hpp"
#include "tools/deblur/capture_run.hpp"
#include "tools/deblur/chosen_frames.hpp"

namespace bolo::tools {

class BlockSink final : public pipeline::FrameSink {
 public:
  // Frames outside [frames.first, frames.end) pass by; the first one behind ends the run.
  BlockSink(ChosenFrames chosen, replay::FrameRange frames, std::filesystem::path file, DeblurSink::Beat beat);

  Status open(const pipeline::SinkFormat& format) override;
  void publish(const pipeline::PublishedFrame& frame, const pipeline::PipelineStats& stats) noexcept override;
  void idle(const pipeline::PipelineStats& stats) noexcept override;
  void close() noexcept override {}

  // The file is written to its end. Thread: setup, after the pipeline's run().
  Status finish();
  const std::atomic<bool>& stop_requested() const noexcept { return stop_requested_; }
  // The error that stopped it, if any; also when the beat did.
  const Status& status() const noexcept { return status_; }
  std::uint64_t frames_in() const noexcept { return frames_in_; }  // of the block
  CaptureRun::Block& block() noexcept { return block_; }

 private:
  Status take(const pipeline::PublishedFrame& frame);
  void beat() noexcept;

  struct Close {
    void operator()(std::FILE* file) const { std::fclose(file); }
  };

  ChosenFrames chosen_;
  replay::FrameRange frames_;
  std::filesystem::path file_;
  DeblurSink::Beat beat_;
  std::unique_ptr<std::FILE, Close> out_;
  CaptureRun::Block block_;
  std::uint64_t frames_in_ = 0;
  Status status_;
  std::atomic<bool> stop_requested_{false};
};

}  // namespace bolo::tools

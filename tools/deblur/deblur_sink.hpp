// The sink of `bolo deblur`: writes the sharp frames of a capture into another capture, and judges them where the
// truth is known.
#pragma once

#include <atomic>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "src/capture/capture.hpp"
#include "src/pipeline/sink.hpp"
#include "tools/deblur/chosen_frames.hpp"

namespace bolo::tools {

// Root mean square difference from the truth, K, over all frames written.
struct Rmse {
  double blurred_k = 0.0;
  double deblurred_k = 0.0;
};

class DeblurSink final : public pipeline::FrameSink {
 public:
  // Called with each frame that came, and while none comes: how many there were; false ends the run.
  using Beat = std::function<bool(std::uint64_t)>;

  DeblurSink(ChosenFrames frames, OutputFile output, Beat beat);
  ~DeblurSink() override;

  Status open(const pipeline::SinkFormat& format) override;
  void publish(const pipeline::PublishedFrame& frame, const pipeline::PipelineStats& stats) noexcept override;
  void idle(const pipeline::PipelineStats& stats) noexcept override;
  void close() noexcept override {}

  // A frame that was deblurred elsewhere: `plane` as ChosenFrames has it, `errors` when there is a truth. In rising
  // order; open() went before. Thread: setup.
  Status write(std::size_t index, const void* plane, const SquareErrors& errors);

  // Copies stimulus and events, writes the settings, and gives the output its name. Without it the destructor removes
  // what was written. `files`: further root attributes, name and text. Thread: setup, after the pipeline's run().
  Status finish(std::string_view isa, const std::vector<std::pair<std::string, std::string>>& files = {});

  // Set when nothing more can come of this run: an error, or the user's interruption. Thread: any.
  const std::atomic<bool>& stop_requested() const noexcept { return stop_requested_; }
  // The error that stopped it, if any. Thread: setup, after the pipeline's run().
  const Status& status() const noexcept { return status_; }
  std::uint64_t frames_out() const noexcept { return frames_out_; }
  std::optional<Rmse> rmse() const;

 private:
  Status take(const pipeline::PublishedFrame& frame);
  void beat() noexcept;

  ChosenFrames frames_;
  OutputFile output_;
  Beat beat_;
  std::optional<capture::CaptureWriter> writer_;
  SquareErrors squares_;
  std::uint64_t frames_in_ = 0;
  std::uint64_t frames_out_ = 0;
  bool finished_ = false;
  Status status_;
  std::atomic<bool> stop_requested_{false};
};

}  // namespace bolo::tools

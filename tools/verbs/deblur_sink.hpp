// The sink of `bolo deblur`: writes the sharp frames of a capture into another capture, and judges them where the
// truth is known.
#pragma once

#include <atomic>
#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "bolo/capture/capture.hpp"
#include "bolo/pipeline/sink.hpp"
#include "tools/verbs/cli.hpp"
#include "tools/verbs/pixel_choice.hpp"

namespace bolo::tools {

// Root mean square difference from the truth, K, over all frames written.
struct Rmse {
  double blurred_k = 0.0;
  double deblurred_k = 0.0;
};

class DeblurSink final : public pipeline::FrameSink {
 public:
  // `input` (from `input_file`) is read here for /t, /frame_id and /truth: a reader of its own, not the one that
  // replays.
  DeblurSink(std::filesystem::path input_file, capture::CaptureReader input, std::filesystem::path output,
             PixelChoice choice);
  ~DeblurSink() override;

  Status open(const pipeline::SinkFormat& format) override;
  void publish(const pipeline::PublishedFrame& frame, const pipeline::PipelineStats& stats) noexcept override;
  void close() noexcept override {}

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
  Status refuse_nan(const pipeline::PublishedFrame& frame) const;
  Status read_truth(std::size_t index);
  void judge();

  std::filesystem::path input_file_;
  capture::CaptureReader input_;
  std::filesystem::path output_;
  PixelChoice choice_;
  Progress progress_;
  std::optional<capture::CaptureWriter> writer_;
  pipeline::SinkFormat format_;
  LinearScale output_scale_;
  std::vector<float> whole_truth_;
  std::vector<float> truth_;    // of the chosen pixels; empty when the input has none
  std::vector<std::byte> raw_;  // the chosen pixels of the frame
  std::vector<std::byte> deblurred_;
  double blurred_square_ = 0.0;
  double deblurred_square_ = 0.0;
  std::uint64_t frames_in_ = 0;
  std::uint64_t frames_out_ = 0;
  std::size_t index_ = 0;  // of the next input frame that may come
  bool finished_ = false;
  Status status_;
  std::atomic<bool> stop_requested_{false};
};

}  // namespace bolo::tools

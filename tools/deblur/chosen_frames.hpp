// What the sinks of `bolo deblur` make of a published frame: its place in the capture, the chosen pixels, and how far
// they are from the truth.
#pragma once

#include <cstddef>
#include <filesystem>
#include <optional>
#include <utility>
#include <vector>

#include "src/capture/capture.hpp"
#include "src/pipeline/sink.hpp"
#include "tools/deblur/pixel_choice.hpp"

namespace bolo::tools {

// Sums over the chosen pixels of a frame of (value - truth)^2, K^2.
struct SquareErrors {
  double blurred = 0.0;
  double deblurred = 0.0;
};

// Frames come in rising order. Thread: pipeline, after open().
class ChosenFrames {
 public:
  // `input` (from `input_file`) is read here for /t, /frame_id and /truth: a reader of its own, not the one that
  // replays.
  ChosenFrames(std::filesystem::path input_file, capture::CaptureReader input, PixelChoice choice);

  void open(const pipeline::SinkFormat& format);

  // The frame's place in the capture, its chosen pixels. kBadInput for a value that is no number.
  Status take(const pipeline::PublishedFrame& frame);
  std::size_t index() const { return index_; }
  // It was deblurred: not of a window that is still filling.
  bool sharp() const { return sharp_; }
  const void* deblurred() const { return deblurred_.data(); }
  // Of the frame taken last; zero without truth.
  Result<SquareErrors> errors();

  // Chosen pixels of frame `index`; null without truth, K.
  Result<const float*> truth(std::size_t index);

  const capture::CaptureReader& input() const { return input_; }
  const PixelChoice& choice() const { return choice_; }
  const pipeline::SinkFormat& format() const { return format_; }
  // Of what is written: frame size, type and scale.
  const capture::CaptureInfo& written() const { return written_; }
  std::size_t bytes() const { return deblurred_.size(); }

 private:
  Status refuse_nan(const pipeline::PublishedFrame& frame) const;

  std::filesystem::path input_file_;
  capture::CaptureReader input_;
  PixelChoice choice_;
  pipeline::SinkFormat format_;
  capture::CaptureInfo written_;
  std::vector<float> whole_truth_;
  std::vector<float> truth_;             // of the chosen pixels; empty when the input has none
  std::optional<std::size_t> truth_of_;  // whose truth that is
  std::vector<std::byte> raw_;           // the chosen pixels of the frame
  std::vector<std::byte> deblurred_;
  std::size_t index_ = 0;
  bool sharp_ = false;
};

}  // namespace bolo::tools

// Runs one capture through the same pipeline as the camera's frames.
#pragma once

#include <array>
#include <atomic>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "src/capture/capture.hpp"
#include "src/core/result.hpp"
#include "src/deblur/settings.hpp"
#include "src/pipeline/sink.hpp"
#include "tools/deblur/pixel_choice.hpp"
#include "tools/deblur/request.hpp"

namespace bolo::tools {

// --- The sink of `bolo deblur`: writes sharp frames to another capture and compares them with the truth, if known.

// Root mean square error against the truth, K, over all frames written.
struct Rmse {
  double blurred_k = 0.0;
  double deblurred_k = 0.0;
};

class DeblurSink final : public pipeline::FrameSink {
 public:
  // Called for each received frame with the count so far, and true if this frame was solved.
  using FrameCallback = std::function<void(std::uint64_t, bool)>;

  // `input` reads /t, /frame_id and /truth from `input_file`; it is not the reader that replays.
  DeblurSink(std::filesystem::path input_file, capture::CaptureReader input, PixelChoice choice, OutputFile output,
             FrameCallback on_frame);
  ~DeblurSink() override;

  Status open(const pipeline::SinkFormat& format) override;
  void publish(const pipeline::PublishedFrame& frame, const pipeline::PipelineStats& stats) noexcept override;
  void close() noexcept override {}

  // Copies stimulus and events, writes the settings, and renames the output to its final name; without this call the
  // destructor removes it. `files`: further root attributes, name and text; `made_from`: the last attribute, omitted if
  // empty. Thread: setup, after the pipeline's run().
  using Files = std::vector<std::pair<std::string, std::string>>;
  Status finish(std::string_view isa, const Files& files, const std::string& made_from);
  // The same for a partial output, which stays a ".part" without `made_from`. Does not wait for the disk.
  Status keep_part(std::string_view isa, const Files& files);

  // True after an error that makes the rest of the run useless. Thread: any.
  const std::atomic<bool>& stop_requested() const noexcept { return stop_requested_; }
  // The error that stopped it, if any. Thread: setup, after the pipeline's run().
  const Status& status() const noexcept { return status_; }
  std::uint64_t frames_out() const noexcept { return frames_out_; }
  std::optional<Rmse> rmse() const;

 private:
  Status take(const pipeline::PublishedFrame& frame);
  // kBadInput if a chosen pixel is NaN.
  Status refuse_nan(const pipeline::PublishedFrame& frame) const;
  Status write_settings(std::string_view isa, const Files& files);
  const BlockMotion* motion_of(const pipeline::PublishedFrame& frame);

  std::filesystem::path input_file_;
  capture::CaptureReader input_;
  PixelChoice choice_;
  OutputFile output_;
  FrameCallback on_frame_;
  pipeline::SinkFormat format_;
  capture::CaptureInfo written_;  // size, type and scale of the written frames
  std::optional<capture::CaptureWriter> writer_;
  // The current frame. All but the first hold the chosen pixels; the truths are empty if the input has none.
  std::vector<float> whole_truth_;
  std::vector<float> truth_;
  std::vector<std::byte> raw_;
  std::vector<std::byte> deblurred_;
  std::vector<BlockMotion> motion_;
  std::size_t index_ = 0;         // in the input; frames arrive in rising order
  bool sharp_ = false;            // the frame was deblurred: the window was full
  double blurred_squares_ = 0.0;  // sums over all frames of (value - truth)^2, K^2
  double deblurred_squares_ = 0.0;
  std::uint64_t frames_in_ = 0;
  std::uint64_t frames_out_ = 0;
  bool kept_ = false;  // finished, or left as a ".part"
  Status status_;
  std::atomic<bool> stop_requested_{false};
};

struct RunFacts {
  std::uint64_t frames_out = 0;
  std::uint64_t lost = 0;
  double deblur_ms = 0.0;  // in corrections and solver, all frames
  deblur::Settings settings;
  std::string isa;
  std::string solver_text;
  std::optional<Rmse> rmse;
  std::array<std::uint64_t, kGyroUses> gyro{};  // number of frames by use of the gyro
};

// Captures shorter than the window are refused before there is a pipeline. Errors name the file. Thread: setup.
class CaptureRun {
 public:
  // Opens and checks the capture, and prints warnings. The request must outlive the run.
  static Result<CaptureRun> open(const DeblurRequest& request, const std::filesystem::path& file);

  const capture::CaptureInfo& info() const { return reader_->info(); }
  const capture::CaptureReader& reader() const { return *reader_; }
  const pipeline::PipelineOptions& options() const { return options_; }

  // Deblurs the whole capture into `output`, with the attribute `made_from` unless empty. If the options' give_up ends
  // it, solved frames remain as a ".part" for `bolo recover`: an output under its final name is always complete.
  Result<RunFacts> run(const OutputFile& output, const std::string& made_from,
                       const DeblurSink::FrameCallback& on_frame);

 private:
  CaptureRun(const DeblurRequest& request, std::filesystem::path file,
             std::shared_ptr<const capture::CaptureReader> reader, pipeline::PipelineOptions options);

  const DeblurRequest* request_;
  std::filesystem::path file_;
  std::shared_ptr<const capture::CaptureReader> reader_;
  pipeline::PipelineOptions options_;
  std::unique_ptr<Gyro> gyro_;
};

// --- Report of `bolo deblur`, as text and JSON.

struct CaptureSummary {
  DeblurFile file;
  std::uint64_t frames_in = 0;
  std::size_t points = 0;
  RunFacts facts;
};

struct FailedCapture {
  std::filesystem::path file;
  Error error;
};

// Captures of this process' share that go into a folder.
struct FolderSummary {
  std::vector<CaptureSummary> captures;
  std::vector<FailedCapture> failed;
  std::vector<std::filesystem::path> skipped;    // their outputs existed
  std::vector<std::filesystem::path> elsewhere;  // another process is writing their outputs
  double seconds = 0.0;
};

void print_capture(const DeblurRequest& request, const CaptureSummary& capture, double seconds);
void print_folder(const DeblurRequest& request, const FolderSummary& summary);

}  // namespace bolo::tools

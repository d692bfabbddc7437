// One capture through the same pipeline as the camera's frames: whole, a block of it, or past all of it for what its
// blocks must know of each other.
#pragma once

#include <cstdint>
#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "drivers/replay/replay_source.hpp"
#include "src/capture/capture.hpp"
#include "src/core/result.hpp"
#include "src/deblur/settings.hpp"
#include "tools/deblur/deblur_sink.hpp"
#include "tools/deblur/request.hpp"

namespace bolo::tools {

// What a run was, and how long it took.
struct RunFacts {
  std::uint64_t frames_out = 0;
  std::uint64_t lost = 0;
  double deblur_ms = 0.0;  // in the solver and before it, all frames
  deblur::Settings settings;
  std::string isa;
  std::string solver_text;
  std::optional<Rmse> rmse;
};

// Frames without a window are refused before there is a pipeline. Errors name the file. Thread: setup.
class CaptureRun {
 public:
  // Opens the capture, checks it, and prints what is odd about it. The request outlives it.
  static Result<CaptureRun> open(const DeblurRequest& request, const std::filesystem::path& file, bool quiet = false);

  const capture::CaptureInfo& info() const { return reader_->info(); }
  const capture::CaptureReader& reader() const { return *reader_; }
  const pipeline::PipelineOptions& options() const { return options_; }

  // Deblurs all of it into a capture `output`.
  Result<RunFacts> whole(const OutputFile& output, const DeblurSink::Beat& beat);

  // Deblurs frames [first, end) into the file `planes`: those that have a window, as they stand in a frame of the
  // output, one after the other. `state`: of StreamWalk where the block does not begin the capture, else empty.
  struct Block {
    std::vector<replay::FrameRange> written;  // places in the capture of the planes in the file
    std::vector<SquareErrors> errors;         // of each, when there is a truth
    std::uint32_t crc = 0;                    // CRC-32 of the file
    std::uint64_t lost = 0;
    double deblur_ms = 0.0;
  };
  Result<Block> block(replay::FrameRange frames, const std::string& state, const std::filesystem::path& planes,
                      const DeblurSink::Beat& beat);

  // The state for a block that begins with frame `next`, from that of one that begins with frame `from` (0: none).
  Result<std::string> walk(std::size_t from, const std::string& state, std::size_t next, const DeblurSink::Beat& beat);
  // Blocks need such states.
  Result<bool> needs_walk() const;

  // Puts blocks together into a capture `output`: the same bytes that whole() writes. `next_plane` is asked for each
  // plane in rising order of its place; null: there are no more.
  struct Plane {
    std::size_t index = 0;
    const void* values = nullptr;
    SquareErrors errors;
  };
  using NextPlane = std::function<Result<std::optional<Plane>>()>;
  Result<RunFacts> put_together(const std::filesystem::path& output, const NextPlane& next_plane,
                                const DeblurSink::Beat& beat);

  // Bytes of a plane of the output.
  std::size_t plane_size() const;

 private:
  CaptureRun(const DeblurRequest& request, std::filesystem::path file,
             std::shared_ptr<const capture::CaptureReader> reader, pipeline::PipelineOptions options);

  Result<ChosenFrames> chosen() const;
  std::size_t feed_begin(std::size_t first) const;
  std::size_t feed_end(std::size_t end) const;
  std::uint64_t missing_before(std::size_t first, std::size_t end) const;

  const DeblurRequest* request_;
  std::filesystem::path file_;
  std::shared_ptr<const capture::CaptureReader> reader_;
  pipeline::PipelineOptions options_;
};

}  // namespace bolo::tools

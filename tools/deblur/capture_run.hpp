// One capture through the same pipeline as the camera's frames.
#pragma once

#include <array>
#include <cstdint>
#include <filesystem>
#include <memory>
#include <optional>
#include <string>

#include "src/capture/capture.hpp"
#include "src/core/result.hpp"
#include "src/deblur/settings.hpp"
#include "tools/deblur/deblur_sink.hpp"
#include "tools/deblur/request.hpp"

namespace bolo::tools {

// Counts and duration of a run.
struct RunFacts {
  std::uint64_t frames_out = 0;
  std::uint64_t lost = 0;
  double deblur_ms = 0.0;  // in the solver and before it, all frames
  deblur::Settings settings;
  std::string isa;
  std::string solver_text;
  std::optional<Rmse> rmse;
  std::array<std::uint64_t, kGyroUses> gyro{};  // frames by what became of it
};

// Frames without a window are refused before there is a pipeline. Errors name the file. Thread: setup.
class CaptureRun {
 public:
  // Opens the capture, checks it, and prints what is odd about it. The request outlives it.
  static Result<CaptureRun> open(const DeblurRequest& request, const std::filesystem::path& file);

  const capture::CaptureInfo& info() const { return reader_->info(); }
  const capture::CaptureReader& reader() const { return *reader_; }
  const pipeline::PipelineOptions& options() const { return options_; }

  // Deblurs all of it into a capture `output`; `made_from` becomes an attribute of it unless it is empty. Where the
  // options' give_up ends it, what was solved is kept as the output's ".part", which `bolo recover` finishes: an output
  // under its own name is always whole.
  Result<RunFacts> run(const OutputFile& output, const std::string& made_from, const DeblurSink::Heard& heard);

 private:
  CaptureRun(const DeblurRequest& request, std::filesystem::path file,
             std::shared_ptr<const capture::CaptureReader> reader, pipeline::PipelineOptions options);

  const DeblurRequest* request_;
  std::filesystem::path file_;
  std::shared_ptr<const capture::CaptureReader> reader_;
  pipeline::PipelineOptions options_;
  std::unique_ptr<Gyro> gyro_;
};

}  // namespace bolo::tools

#include "tools/deblur/capture_run.hpp"

#include <cstdio>
#include <utility>

#include "drivers/replay/replay_source.hpp"
#include "src/core/clock.hpp"
#include "src/pipeline/pipeline.hpp"
#include "tools/deblur/gyro_file.hpp"

namespace bolo::tools {
namespace {

// The error that states what was solved before the run was given up.
Error interruption(DeblurSink& sink, const pipeline::Pipeline& pipeline, const DeblurRequest& request,
                   const std::filesystem::path& output) {
  if (sink.frames_out() == 0) {
    return {ErrorKind::kFailed, "interrupted before any frame was solved; " + output.string() + " was not written"};
  }
  if (const Status kept = sink.keep_part(pipeline.isa(), files_behind(request)); !kept) return kept.error();
  const std::string part = output.string() + ".part";
  return {ErrorKind::kFailed, "interrupted; " + std::to_string(sink.frames_out()) + " frames are kept in " + part +
                                  ", which bolo recover finishes"};
}

}  // namespace

CaptureRun::CaptureRun(const DeblurRequest& request, std::filesystem::path file,
                       std::shared_ptr<const capture::CaptureReader> reader, pipeline::PipelineOptions options)
    : request_(&request), file_(std::move(file)), reader_(std::move(reader)), options_(std::move(options)) {
  if (request.gyro != nullptr) gyro_ = std::make_unique<GyroOfCapture>(request.gyro, reader_);
  options_.deblur.gyro = gyro_.get();
}

Result<CaptureRun> CaptureRun::open(const DeblurRequest& request, const std::filesystem::path& file) {
  ASSIGN_OR_RETURN(auto reader, capture::CaptureReader::open(file));
  RETURN_IF_ERROR(check_capture(request, file, reader.info()));
  for (const std::string& line : reader.warnings()) {
    std::fprintf(stderr, "bolo deblur: %s: %s\n", file.c_str(), line.c_str());
  }
  pipeline::PipelineOptions options = request.options;
  ASSIGN_OR_RETURN(options.points, points_of(request, reader.info().format.geometry));
  return CaptureRun(request, file, std::make_shared<const capture::CaptureReader>(std::move(reader)),
                    std::move(options));
}

Result<RunFacts> CaptureRun::run(const OutputFile& output, const std::string& made_from,
                                 const DeblurSink::Heard& heard) {
  ASSIGN_OR_RETURN(auto own_reader, capture::CaptureReader::open(file_));
  PixelChoice choice(info().format.geometry, options_.region, options_.points);
  DeblurSink sink(file_, std::move(own_reader), std::move(choice), output, heard);
  auto source = std::make_unique<replay::ReplaySource>(reader_, replay::Pace::kAsFastAsPossible);
  const replay::ReplaySource& replayed = *source;
  ASSIGN_OR_RETURN(const auto pipeline, pipeline::Pipeline::create(std::move(source), {&sink}, options_));
  RETURN_IF_ERROR(pipeline->run(sink.stop_requested()));
  RETURN_IF_ERROR(replayed.result());
  RETURN_IF_ERROR(sink.status());
  if (options_.give_up != nullptr && options_.give_up->load(std::memory_order_relaxed)) {
    return tl::unexpected(interruption(sink, *pipeline, *request_, output.path));
  }
  if (sink.frames_out() == 0) {
    return bad_input(file_.string() + ": no full window of " + std::to_string(options_.deblur.window) +
                     " frames between its breaks (events, jumps in time); give a smaller --window");
  }
  RETURN_IF_ERROR(sink.finish(pipeline->isa(), files_behind(*request_), made_from));
  const pipeline::PipelineStats& stats = pipeline->stats();
  RunFacts facts{
      sink.frames_out(),    stats.inlet.losses().total(), static_cast<double>(stats.deblur_ns.value()) * kMsPerNs,
      pipeline->settings(), std::string(pipeline->isa()), pipeline->solver_text(),
      sink.rmse()};
  for (std::size_t i = 0; i < kGyroUses; ++i) facts.gyro[i] = stats.gyro[i].value();
  return facts;
}

}  // namespace bolo::tools

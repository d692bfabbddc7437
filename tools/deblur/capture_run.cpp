#include "tools/deblur/capture_run.hpp"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <utility>

#include "drivers/replay/breaks.hpp"
#include "src/core/clock.hpp"
#include "src/pipeline/pipeline.hpp"
#include "src/pipeline/stream_walk.hpp"
#include "tools/deblur/block_sink.hpp"

namespace bolo::tools {
namespace {

Status no_window(const std::filesystem::path& file, const DeblurRequest& request) {
  return bad_input(file.string() + ": no full window of " + std::to_string(request.options.deblur.window) +
                   " frames between its breaks (events, jumps in time); give a smaller --window");
}

void take_facts(const pipeline::Pipeline& pipeline, RunFacts& facts) {
  facts.settings = pipeline.settings();
  facts.isa = pipeline.isa();
  facts.solver_text = pipeline.solver_text();
}

}  // namespace

CaptureRun::CaptureRun(const DeblurRequest& request, std::filesystem::path file,
                       std::shared_ptr<const capture::CaptureReader> reader, pipeline::PipelineOptions options)
    : request_(&request), file_(std::move(file)), reader_(std::move(reader)), options_(std::move(options)) {}

Result<CaptureRun> CaptureRun::open(const DeblurRequest& request, const std::filesystem::path& file, bool quiet) {
  auto reader = capture::CaptureReader::open(file);
  if (!reader) return tl::unexpected(reader.error());
  if (Status status = check_capture(request, file, reader->info()); !status) return tl::unexpected(status.error());
  for (const std::string& line : reader->warnings()) {
    if (!quiet) std::fprintf(stderr, "bolo deblur: %s: %s\n", file.c_str(), line.c_str());
  }
  pipeline::PipelineOptions options = request.options;
  deblur::Settings settings = options.deblur;
  settings.period_s = reader->info().format.frame_period_s;
  const std::string little = deblur::little_to_undo(settings);
  if (!quiet && !little.empty()) std::fprintf(stderr, "bolo deblur: %s: %s\n", file.c_str(), little.c_str());
  auto points = points_of(request, reader->info().format.geometry);
  if (!points) return tl::unexpected(points.error());
  options.points = std::move(*points);
  return CaptureRun(request, file, std::make_shared<const capture::CaptureReader>(std::move(*reader)),
                    std::move(options));
}

Result<ChosenFrames> CaptureRun::chosen() const {
  auto own_reader = capture::CaptureReader::open(file_);
  if (!own_reader) return tl::unexpected(own_reader.error());
  PixelChoice choice(info().format.geometry, options_.region, options_.points);
  return ChosenFrames(file_, std::move(*own_reader), std::move(choice));
}

std::size_t CaptureRun::plane_size() const {
  return plane_bytes(PixelChoice(info().format.geometry, options_.region, options_.points).geometry(), options_.output);
}

Result<RunFacts> CaptureRun::whole(const std::filesystem::path& output, const DeblurSink::Beat& beat) {
  auto chosen = this->chosen();
  if (!chosen) return tl::unexpected(chosen.error());
  bool told_to_end = false;
  DeblurSink sink(std::move(*chosen), output, [&](std::uint64_t frames) {
    told_to_end = told_to_end || !beat(frames);
    return !told_to_end;
  });
  auto source = std::make_unique<replay::ReplaySource>(reader_, replay::Pace::kAsFastAsPossible);
  const replay::ReplaySource& replayed = *source;
  auto pipeline = pipeline::Pipeline::create(std::move(source), {&sink}, options_);
  if (!pipeline) return tl::unexpected(pipeline.error());
  const Status run = (*pipeline)->run(sink.stop_requested());
  for (const Status& status : {run, replayed.result(), sink.status()}) {
    if (!status) return tl::unexpected(status.error());
  }
  if (told_to_end) return failed("interrupted; " + output.string() + " was not written");
  if (sink.frames_out() == 0) return tl::unexpected(no_window(file_, *request_).error());
  if (Status status = sink.finish((*pipeline)->isa(), files_behind(*request_)); !status) {
    return tl::unexpected(status.error());
  }
  const pipeline::PipelineStats& stats = (*pipeline)->stats();
  RunFacts facts;
  take_facts(**pipeline, facts);
  facts.frames_out = sink.frames_out();
  facts.lost = stats.inlet.losses().total();
  facts.deblur_ms = static_cast<double>(stats.deblur_ns.value()) * kMsPerNs;
  facts.rmse = sink.rmse();
  return facts;
}

std::size_t CaptureRun::feed_begin(std::size_t first) const {
  const auto halo = static_cast<std::size_t>(pipeline::halo_frames(options_));
  return first > halo ? first - halo : 0;
}

// With a look-ahead, frames behind show what the last ones need; of frames that repeat others it may take some more.
std::size_t CaptureRun::feed_end(std::size_t end) const {
  const deblur::Settings& settings = options_.deblur;
  if (settings.lookahead == 0) return end;
  return std::min(end + static_cast<std::size_t>(settings.lookahead + settings.window), info().frames);
}

// Frames that the counter says are missing right before frames [first, end).
std::uint64_t CaptureRun::missing_before(std::size_t first, std::size_t end) const {
  const std::vector<std::uint64_t>& ids = reader_->frame_id();
  replay::Breaks breaks(reader_->events());
  if (first > 0) breaks.before(reader_->t()[first - 1]);
  std::uint64_t missing = 0;
  for (std::size_t i = first; i < end; ++i) {
    if (!breaks.before(reader_->t()[i]) && i > 0) missing += ids[i] - ids[i - 1] - 1;
  }
  return missing;
}

Result<CaptureRun::Block> CaptureRun::block(replay::FrameRange frames, const std::string& state,
                                            const std::filesystem::path& planes, const DeblurSink::Beat& beat) {
  auto chosen = this->chosen();
  if (!chosen) return tl::unexpected(chosen.error());
  BlockSink sink(std::move(*chosen), frames, planes, beat);
  auto source =
      std::make_unique<replay::ReplaySource>(reader_, replay::Pace::kAsFastAsPossible, std::nullopt, replay::Laps::kOne,
                                             replay::FrameRange{feed_begin(frames.first), feed_end(frames.end)});
  const replay::ReplaySource& replayed = *source;
  pipeline::PipelineOptions options = options_;
  options.resume = state;
  auto pipeline = pipeline::Pipeline::create(std::move(source), {&sink}, options);
  if (!pipeline) return tl::unexpected(pipeline.error());
  const Status run = (*pipeline)->run(sink.stop_requested());
  for (const Status& status : {run, replayed.result(), sink.status(), sink.finish()}) {
    if (!status) return tl::unexpected(status.error());
  }
  Block& block = sink.block();
  const std::uint64_t repeats = frames.end - frames.first - sink.frames_in();
  block.lost = missing_before(frames.first, frames.end) + repeats;
  block.deblur_ms = static_cast<double>((*pipeline)->stats().deblur_ns.value()) * kMsPerNs;
  return std::move(block);
}

Result<bool> CaptureRun::needs_walk() const { return pipeline::remembers(options_, info().format); }

Result<std::string> CaptureRun::walk(std::size_t from, const std::string& state, std::size_t next,
                                     const DeblurSink::Beat& beat) {
  pipeline::PipelineOptions options = options_;
  options.resume = state;
  const StreamFormat& format = info().format;
  auto walk = pipeline::StreamWalk::create(options, format);
  if (!walk) return tl::unexpected(walk.error());
  std::vector<std::byte> plane(plane_bytes(format.geometry, format.type));
  replay::Breaks breaks(reader_->events());
  const std::size_t begin = feed_begin(from);
  const std::size_t mark = feed_begin(next);
  if (begin > 0) breaks.before(reader_->t()[begin - 1]);
  for (std::size_t i = begin; i < info().frames && !(*walk)->marked(); ++i) {
    if (!beat(0)) return failed("told to end");
    if (Status status = reader_->read_frame(i, plane.data()); !status) return tl::unexpected(status.error());
    if (i == mark) (*walk)->mark();
    FrameMeta meta;
    meta.frame_id = reader_->frame_id()[i];
    meta.camera_ns = std::llround(reader_->t()[i] * kNsPerSecond);
    (*walk)->step(meta, plane.data(), breaks.before(reader_->t()[i]));
  }
  return (*walk)->state();
}

// The pipeline is made for what it says of the output, and never run.
Result<RunFacts> CaptureRun::put_together(const std::filesystem::path& output, const NextPlane& next_plane,
                                          const DeblurSink::Beat& beat) {
  auto chosen = this->chosen();
  if (!chosen) return tl::unexpected(chosen.error());
  DeblurSink sink(std::move(*chosen), output, beat);
  auto source = std::make_unique<replay::ReplaySource>(reader_, replay::Pace::kAsFastAsPossible);
  auto pipeline = pipeline::Pipeline::create(std::move(source), {&sink}, options_);
  if (!pipeline) return tl::unexpected(pipeline.error());
  while (true) {
    const auto plane = next_plane();
    if (!plane) return tl::unexpected(plane.error());
    if (!*plane) break;
    if (Status status = sink.write((*plane)->index, (*plane)->values, (*plane)->errors); !status) {
      return tl::unexpected(status.error());
    }
    if (!beat(0)) return failed("told to end");
  }
  if (sink.frames_out() == 0) return tl::unexpected(no_window(file_, *request_).error());
  if (Status status = sink.finish((*pipeline)->isa(), files_behind(*request_)); !status) {
    return tl::unexpected(status.error());
  }
  RunFacts facts;
  take_facts(**pipeline, facts);
  facts.frames_out = sink.frames_out();
  facts.rmse = sink.rmse();
  return facts;
}

}  // namespace bolo::tools

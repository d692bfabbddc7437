#include "tools/bolod/compose.hpp"

#include <cstdio>

namespace bolo::daemon {
namespace {

Result<ComposedSource> make_replay(const ReplayOptions& options) {
  Result<capture::CaptureReader> reader = capture::CaptureReader::open(options.file);
  if (!reader) return tl::unexpected<Error>(reader.error());
  ComposedSource composed;
  composed.warnings = reader->warnings();
  auto source = std::make_unique<replay::ReplaySource>(
      std::make_shared<const capture::CaptureReader>(std::move(*reader)), options.pace, std::nullopt, options.laps);
  composed.replay = source.get();
  composed.source = std::move(source);
  return composed;
}

}  // namespace

Result<ComposedSource> make_source(const DaemonConfig& config) {
  if (config.source == SourceType::kReplay) return make_replay(config.replay);
  ComposedSource composed;
  auto source = std::make_unique<genicam::GenicamSource>(config.camera);
  composed.camera = source.get();
  composed.source = std::move(source);
  return composed;
}

bool waits_for_frames(const DaemonConfig& config) {
  return config.source == SourceType::kReplay && config.replay.pace == replay::Pace::kAsFastAsPossible;
}

ComposedSinks make_sinks(const DaemonConfig& config) {
  ComposedSinks sinks;
  if (config.shm_enabled) sinks.all.push_back(std::make_unique<shm::ShmSink>(config.shm));
  for (std::size_t i = 0; i < kVideoDevices; ++i) {
    if (!config.video[i].enabled) continue;
    auto sink = std::make_unique<v4l2::V4l2Sink>(config.video[i].sink);
    sinks.video[i] = sink.get();
    sinks.all.push_back(std::move(sink));
  }
  return sinks;
}

namespace {

std::string describe_sinks(const DaemonConfig& config) {
  std::string words = config.shm_enabled ? "shared memory /bolo." + config.name : "";
  for (const VideoOptions& video : config.video) {
    if (!video.enabled) continue;
    words += (words.empty() ? "" : ", ") + video.sink.device + " (" +
             (video.sink.plane == v4l2::Plane::kRaw ? "raw" : "deblurred") + ", " +
             std::string(v4l2::name(video.sink.format)) + ")";
  }
  return words.empty() ? "nowhere: shm.enable is false" : words;
}

}  // namespace

std::string describe(const DaemonConfig& config, const pipeline::Pipeline& pipeline) {
  const pipeline::SourceInfo& source = pipeline.source();
  const std::string from = config.source == SourceType::kReplay ? config.replay.file.filename().string() : "camera";
  const std::string serial = source.camera_serial.empty() ? "" : " " + source.camera_serial;
  char frame[64];
  std::snprintf(frame, sizeof frame, "%dx%d at %.4g Hz", source.format.geometry.width, source.format.geometry.height,
                1.0 / source.format.frame_period_s);
  const deblur::Settings& settings = pipeline.settings();
  char window[96];
  std::snprintf(window, sizeof window, "window %d, look-ahead %d, tau %.4g ms, %d workers", settings.window,
                settings.lookahead, settings.tau_s * 1e3, config.pipeline.workers);
  return from + " " + source.camera_model + serial + ", " + frame + " -> " + pipeline.solver_text() + ", " + window +
         " -> " + describe_sinks(config);
}

}  // namespace bolo::daemon

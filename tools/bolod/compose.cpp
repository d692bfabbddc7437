#include "tools/bolod/compose.hpp"

#include <fmt/format.h>

#include "drivers/shm/shm_gyro.hpp"
#include "drivers/shm/shm_section.hpp"
#include "drivers/v4l2/v4l2_section.hpp"

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
  if (config.source == SourceType::kV4l2) {
    composed.source = std::make_unique<v4l2_source::V4l2Source>(config.video);
    return composed;
  }
  auto source = std::make_unique<genicam::GenicamSource>(config.camera);
  composed.camera = source.get();
  composed.source = std::move(source);
  return composed;
}

bool waits_for_frames(const DaemonConfig& config) {
  return config.source == SourceType::kReplay && config.replay.pace == replay::Pace::kAsFastAsPossible;
}

std::vector<std::shared_ptr<pipeline::SinkSection>> sink_sections() {
  using v4l2::V4l2Section;
  return {
      std::make_shared<shm::ShmSection>(),
      std::make_shared<V4l2Section>("v4l2",
                                    "frames as a camera of the system, for programs that know only such: v4l2loopback"),
      std::make_shared<V4l2Section>("v4l2_second", "another such device, as raw frames beside sharp ones",
                                    v4l2::V4l2Options{.device = "/dev/video11", .plane = v4l2::Plane::kRaw}),
  };
}

Result<std::unique_ptr<Gyro>> make_gyro(const DaemonConfig& config) {
  if (config.gyro.empty()) return nullptr;
  return shm::ShmGyro::create(config.gyro.substr(kShmGyro.size()));
}

std::vector<std::unique_ptr<pipeline::FrameSink>> make_sinks(const DaemonConfig& config) {
  std::vector<std::unique_ptr<pipeline::FrameSink>> sinks;
  for (const auto& section : config.sinks) sinks.push_back(section->make(config.sink_context()));
  return sinks;
}

namespace {

std::string describe_sinks(const DaemonConfig& config) {
  std::string words;
  for (const auto& section : config.sinks) {
    const std::string sink = section->describe(config.sink_context());
    if (!sink.empty()) words += (words.empty() ? "" : ", ") + sink;
  }
  return words.empty() ? "nowhere: shm.enable is false" : words;
}

}  // namespace

std::string describe(const DaemonConfig& config, const pipeline::Pipeline& pipeline) {
  const pipeline::SourceInfo& source = pipeline.source();
  const std::string from = config.source == SourceType::kReplay ? config.replay.file.filename().string() : "camera";
  const std::string serial = source.camera_serial.empty() ? "" : " " + source.camera_serial;
  const StreamFormat& format = source.format;
  const deblur::Settings& settings = pipeline.settings();
  return fmt::format("{} {}{}, {}x{} at {:.4g} Hz -> {}, window {}, look-ahead {}, tau {:.4g} ms, {} workers -> {}",
                     from, source.camera_model, serial, format.geometry.width, format.geometry.height,
                     1.0 / format.frame_period_s, pipeline.solver_text(), settings.window, settings.lookahead,
                     settings.tau_s * 1e3, config.pipeline.workers, describe_sinks(config));
}

}  // namespace bolo::daemon

// Configuration of `bolod`, read from one TOML file (config/bolod.toml documents every key).
#pragma once

#include <filesystem>
#include <functional>
#include <map>
#include <memory>
#include <string>
#include <string_view>
#include <vector>

#include <spdlog/common.h>

#include "drivers/genicam/genicam_source.hpp"
#include "drivers/replay/replay_source.hpp"
#include "drivers/v4l2_source/v4l2_source.hpp"
#include "src/core/result.hpp"
#include "src/model/camera_profile.hpp"
#include "src/pipeline/pipeline.hpp"
#include "src/pipeline/sink.hpp"
#include "tools/bolod/ros2.hpp"

namespace bolo::daemon {

enum class SourceType {
  kGenicam,  // a camera, or its fake, on the network
  kReplay,   // a capture file, in process
  kV4l2,     // a video device of the kernel
};

struct ReplayOptions {
  std::filesystem::path file;
  replay::Pace pace = replay::Pace::kRealTime;
  replay::Laps laps = replay::Laps::kOne;
};

inline constexpr std::string_view kShmGyro = "shm:";

enum class LogFormat {
  kAuto,     // kJournal when standard error leads to the journal, else kText
  kText,     // time, level, message
  kJournal,  // to the journal, with fields; "<6>message" on standard error where there is none
};

struct LogOptions {
  spdlog::level::level_enum level = spdlog::level::info;
  LogFormat format = LogFormat::kAuto;
};

struct ControlOptions {
  bool enabled = true;
  std::string socket;  // empty: at the default place (tools/bolod/control.hpp)
  unsigned mode = 0660;
};

struct MetricsOptions {
  bool enabled = false;
  std::string listen = "127.0.0.1:9464";
  bool allow_remote = false;  // an address that other computers reach
};

// The sinks that a daemon may have, in the order of their sections in the file, in which they are served: another one
// is a line in daemon.cpp. Thread: any.
std::vector<std::shared_ptr<pipeline::SinkSection>> sink_sections();

struct DaemonConfig {
  DaemonConfig();  // the defaults for an A655sc at 200 Hz

  std::filesystem::path file;                             // that it was read from
  std::map<std::string, std::string, std::less<>> texts;  // its value for each key; of the profile's files, too

  std::string name = "camera";         // of the shared memory and in the log
  std::filesystem::path profile_file;  // empty: `profile` as built in
  model::CameraProfile profile;
  SourceType source = SourceType::kGenicam;
  genicam::CameraOptions camera;
  ReplayOptions replay;
  v4l2_source::V4l2SourceOptions video;
  pipeline::PipelineOptions pipeline;
  std::string gyro;          // kShmGyro and a name; empty: none
  std::string isa = "auto";  // instruction set of the solver's kernels
  bool lock_memory = true;
  std::vector<std::shared_ptr<pipeline::SinkSection>> sinks = sink_sections();  // shared by copies
  Ros2Options ros2;
  ControlOptions control;
  MetricsOptions metrics;
  LogOptions log;

  // Thread: any.
  pipeline::SinkContext sink_context() const;
};

// Reads a configuration and the profile that it names, and checks its keys against each other. Anything wrong is bad
// input: file, line and item. Thread: setup.
Result<DaemonConfig> read_config(const std::filesystem::path& file);

// --- Changes of a configuration that is read again by a running daemon.

// Keys that a running daemon takes up; all others need a restart. Thread: any.
std::vector<std::string> live_keys(const DaemonConfig& config);

struct ConfigChange {
  std::vector<std::string> live;     // changed keys that can be taken up
  std::vector<std::string> restart;  // changed keys that cannot
};

// Thread: any.
ConfigChange compare(const DaemonConfig& running, const DaemonConfig& read);

// The complete commented default configuration. Thread: any.
std::string document_config();

}  // namespace bolo::daemon

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
  kGenicam,  // a camera on the network, or its fake
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
  kAuto,     // kJournal if standard error is the journal, otherwise kText
  kText,     // time, level, message
  kJournal,  // to the journal, with fields; "<6>message" on standard error without a journal
};

struct LogOptions {
  spdlog::level::level_enum level = spdlog::level::info;
  LogFormat format = LogFormat::kAuto;
};

struct ControlOptions {
  bool enabled = true;
  std::string socket;  // empty: default path (tools/bolod/control.hpp)
  unsigned mode = 0660;
};

struct MetricsOptions {
  bool enabled = false;
  std::string listen = "127.0.0.1:9464";
  bool allow_remote = false;  // allow an address that other computers can reach
};

// The available sinks, in the order of their sections, which is that of service. Add one in daemon.cpp. Thread: any.
std::vector<std::shared_ptr<pipeline::SinkSection>> sink_sections();

struct DaemonConfig {
  DaemonConfig();  // defaults for an A655sc at 200 Hz

  std::filesystem::path file;                             // source of this configuration
  std::map<std::string, std::string, std::less<>> texts;  // value of each key; includes the profile's files

  std::string name = "camera";         // of the shared memory and in the log
  std::filesystem::path profile_file;  // empty: built-in `profile`
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

// Reads and checks a configuration and its profile. Any fault is bad input: file, line and item. Thread: setup.
Result<DaemonConfig> read_config(const std::filesystem::path& file);

// --- Changes of the configuration while the daemon runs.

// Keys that take effect at run time; all others need a restart. Thread: any.
std::vector<std::string> live_keys(const DaemonConfig& config);

struct ConfigChange {
  std::vector<std::string> live;     // changed keys that take effect
  std::vector<std::string> restart;  // changed keys that need a restart
};

// Thread: any.
ConfigChange compare(const DaemonConfig& running, const DaemonConfig& read);

// The complete default configuration with comments. Thread: any.
std::string document_config();

}  // namespace bolo::daemon

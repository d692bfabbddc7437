// The daemon: composes source, pipeline and sinks from a configuration, and runs until a signal or the source's end.
#pragma once

#include <filesystem>
#include <memory>
#include <string>
#include <vector>

#include <spdlog/logger.h>

#include "src/core/result.hpp"
#include "tools/bolod/config.hpp"

namespace bolo::daemon {

// read_config(), plus a check of the resources of this computer. Thread: setup.
Result<DaemonConfig> read_config_to_run(const std::filesystem::path& file);

// --- Composition: the only place in the daemon that names concrete drivers.

// A source, and a typed pointer to it for type-specific functions. The pipeline takes ownership.
struct ComposedSource {
  std::unique_ptr<pipeline::FrameSource> source;
  genicam::GenicamSource* camera = nullptr;
  replay::ReplaySource* replay = nullptr;
  std::vector<std::string> warnings{};  // to report to the user
};

// Thread: setup.
Result<ComposedSource> make_source(const DaemonConfig& config);

// True when the source waits for its frames to be taken, so that a full queue is no overload. Thread: any.
bool waits_for_frames(const DaemonConfig& config);

// Null when not configured. Thread: setup.
Result<std::unique_ptr<Gyro>> make_gyro(const DaemonConfig& config);

// One per section of config.sinks; null for disabled ones. Thread: setup.
std::vector<std::unique_ptr<pipeline::FrameSink>> make_sinks(const DaemonConfig& config);

// "genicam FLIR A655sc 640x120 at 200 Hz -> admm ... -> shared memory /bolo.camera". Thread: setup.
std::string describe(const DaemonConfig& config, const pipeline::Pipeline& pipeline);

// Reserves SIGTERM, SIGINT and SIGHUP for Daemon::run() by blocking them in this thread and all that it starts. Call
// before any thread exists. Thread: setup.
void block_signals();

// Ignores signals whose default action would end the daemon without reason (timers, SIGPIPE, ...). With SIGXFSZ
// ignored, a file size limit becomes a reported write error. Thread: setup.
void ignore_signals();

// Effect of SIGHUP: a service reloads its file, a program in a terminal ends.
enum class OnHangup { kReload, kEnd };

class Daemon {
 public:
  // Opens source and sinks, allocates all memory. Bad input: absent camera, name in use, full /dev/shm. Thread: setup.
  static Result<std::unique_ptr<Daemon>> create(const DaemonConfig& config, std::shared_ptr<spdlog::logger> log);
  ~Daemon();

  // Runs the pipeline on its own thread until SIGTERM, SIGINT or the source's end; the calling thread logs changes of
  // state, notifies the service manager (sd_notify), and handles SIGHUP by `on_hangup`; kEnd respects an ignored SIGHUP
  // (nohup). Call once, after block_signals(). Thread: setup.
  Status run(OnHangup on_hangup);

 private:
  struct Impl;
  explicit Daemon(std::unique_ptr<Impl> impl);
  std::unique_ptr<Impl> impl_;
};

}  // namespace bolo::daemon

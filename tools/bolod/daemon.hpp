// The daemon: source, pipeline and sinks put together from a configuration, run until a signal or the source's end.
#pragma once

#include <filesystem>
#include <memory>
#include <string>
#include <vector>

#include <spdlog/logger.h>

#include "src/core/result.hpp"
#include "tools/bolod/config.hpp"

namespace bolo::daemon {

// read_config(), and refuses what this computer has not. Thread: setup.
Result<DaemonConfig> read_config_to_run(const std::filesystem::path& file);

// --- From the configuration to objects: the only place in the daemon that names concrete drivers.

// A source, and the same one by its own type for functions of that type alone. The pipeline comes to own it.
struct ComposedSource {
  std::unique_ptr<pipeline::FrameSource> source;
  genicam::GenicamSource* camera = nullptr;
  replay::ReplaySource* replay = nullptr;
  std::vector<std::string> warnings{};  // what the user should know of this source
};

// Thread: setup.
Result<ComposedSource> make_source(const DaemonConfig& config);

// True when the source waits until its frames are taken, so that a full queue is no overload. Thread: any.
bool waits_for_frames(const DaemonConfig& config);

// Null where none was asked for. Thread: setup.
Result<std::unique_ptr<Gyro>> make_gyro(const DaemonConfig& config);

// One a section of config.sinks; null for those that were not asked for. Thread: setup.
std::vector<std::unique_ptr<pipeline::FrameSink>> make_sinks(const DaemonConfig& config);

// "genicam FLIR A655sc 640x120 at 200 Hz -> admm ... -> shared memory /bolo.camera". Thread: setup.
std::string describe(const DaemonConfig& config, const pipeline::Pipeline& pipeline);

// Keeps SIGTERM, SIGINT and SIGHUP for Daemon::run(): blocked in this thread and all that it starts. To be called
// before any thread exists. Thread: setup.
void block_signals();

// Those without a meaning to a daemon would end it: from a timer, a pipe whose reader went, a slip. A limit on files
// (SIGXFSZ) becomes a full disk: a write error, which is reported. Thread: setup.
void ignore_signals();

// Effect of SIGHUP: a service reads its file again, a program in a terminal ends with it.
enum class OnHangup { kReload, kEnd };

class Daemon {
 public:
  // Opens the source and the sinks and takes all memory. An absent camera, a taken name and a full /dev/shm are bad
  // input. Thread: setup.
  static Result<std::unique_ptr<Daemon>> create(const DaemonConfig& config, std::shared_ptr<spdlog::logger> log);
  ~Daemon();

  // Runs the pipeline on a thread of its own until SIGTERM, SIGINT or the source's end; meanwhile logs changes of
  // state, notifies the service manager (sd_notify) from the calling thread, and reacts to SIGHUP by `on_hangup`; kEnd
  // leaves an ignored one alone (nohup). Called once, after block_signals(). Thread: setup.
  Status run(OnHangup on_hangup);

 private:
  struct Impl;
  explicit Daemon(std::unique_ptr<Impl> impl);
  std::unique_ptr<Impl> impl_;
};

}  // namespace bolo::daemon

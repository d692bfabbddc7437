// From the configuration to objects: the only place in the daemon that names concrete drivers.
#pragma once

#include <memory>
#include <string>
#include <vector>

#include "tools/bolod/config.hpp"

namespace bolo::daemon {

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

}  // namespace bolo::daemon

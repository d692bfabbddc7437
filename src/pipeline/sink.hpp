// Interface of a sink of deblurred frames: shared memory, a video device, a recorder, a file.
#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "src/core/frame.hpp"
#include "src/core/result.hpp"
#include "src/core/scene_motion.hpp"
#include "src/deblur/settings.hpp"
#include "src/model/strict_toml.hpp"
#include "src/pipeline/notices.hpp"
#include "src/pipeline/source.hpp"
#include "src/pipeline/stats.hpp"

namespace bolo::pipeline {

// One published frame; valid only during publish().
struct PublishedFrame {
  FrameMeta meta;
  std::int64_t publish_ns = 0;          // CLOCK_MONOTONIC, right before the sinks get it
  const void* raw = nullptr;            // the source's pixel type
  const void* deblurred = nullptr;      // the output pixel type; see SinkFormat::region and points
  double noise_k = 0.0;                 // noise used by the solver, K (counts without kelvin); 0: not used
  const SceneMotion* motion = nullptr;  // null: not known for this frame
};

struct SinkFormat {
  SourceInfo source;
  PixelType deblurred_type = PixelType::kUint16;
  deblur::Settings deblur;   // in effect: with the source's own period
  std::string solver_text;   // method, iterations, lambda and instruction set as text
  int iterations_asked = 0;  // as configured; deblur.iterations are those in use
  std::string isa;           // instruction set of the kernels
  bool maps = false;         // pixels have parameters of their own
  bool motion = false;       // frames may carry the scene's motion
  bool undone = false;       // frames are changed before or after the solver (PipelineOptions::undo)
  double row_delay_s = 0.0;  // sensor row r is sampled r * row_delay_s after the frame's time
  // As in PipelineOptions: the solved pixels; with points, planes have only these. Sinks of whole frames refuse both in
  // open().
  std::optional<Region> region{};
  std::vector<std::uint32_t> points{};
};

class SinkSection;

struct SinkNumber {
  std::string_view key;     // in JSON
  std::string_view metric;  // for Prometheus; a name not ending in _total is 1 or 0: currently true or false
  std::string_view help;
  std::uint64_t value = 0;  // since open()

  bool counts() const noexcept { return metric.ends_with("_total"); }
};

struct SinkStatistics {
  std::string_view group;  // kind of the sink, a list in JSON: "video"; empty: no statistics
  std::string_view label;  // meaning of `name`: "device"
  std::string name;
  std::vector<SinkNumber> numbers;
};

class FrameSink {
 public:
  virtual ~FrameSink() = default;

  // Allocates all the memory it will ever need. Thread: setup.
  virtual Status open(const SinkFormat& format) = 0;

  // Takes a copy and returns; counts what it misses. Never waits for readers, allocates or logs. Thread: pipeline.
  virtual void publish(const PublishedFrame& frame, const PipelineStats& stats) noexcept = 0;

  // Called at least every 250 ms while no frames flow, so that readers see a living writer. Thread: pipeline.
  virtual void idle(const PipelineStats& /*stats*/) noexcept {}

  // Thread: setup, after the last publish().
  virtual void close() noexcept = 0;

  // The sink's own numbers. Thread: any.
  virtual SinkStatistics statistics() const { return {}; }

  // Notices since the last call, newest last. Thread: any.
  virtual std::vector<Notice> take_notices() { return {}; }

  // Applies the live keys of its section, which was read again. Thread: any, but one at a time.
  virtual void reload(const SinkSection& /*read*/) {}
};

// --- A sink in a configuration: a section of keys, and the sink that they describe.

// The daemon that a sink belongs to.
struct SinkContext {
  std::string name;            // the daemon's
  std::string control_socket;  // for commands; empty: none
  Geometry frame{};            // 0: not known yet
  deblur::Settings deblur{};
};

class SinkSection {
 public:
  virtual ~SinkSection() = default;

  // Declares the section and its keys, bound to this object, which outlives the table. Thread: any.
  virtual void declare(model::KeyTable& keys) = 0;

  // Paths of the keys that a running sink can apply (FrameSink::reload). Thread: any.
  virtual std::vector<std::string> live_keys() const { return {}; }

  // Checks the keys together, and against earlier sections; errors begin with the place in the file. Thread: any.
  virtual Status check(const model::KeyTable& /*keys*/, const SinkContext& /*context*/,
                       std::span<const std::shared_ptr<SinkSection>> /*before*/) const {
    return {};
  }

  // As in SinkStatistics: the list exists in JSON, empty, even without a sink. Thread: any.
  virtual std::string_view group() const { return {}; }

  // "/dev/video10 (deblurred, y16)", for the log; empty if no sink is configured. Thread: any.
  virtual std::string describe(const SinkContext& context) const = 0;

  // Bytes used in /dev/shm. Thread: any.
  virtual std::uint64_t shared_bytes(const SinkContext& /*context*/) const { return 0; }

  // Null if no sink is configured. Thread: setup.
  virtual std::unique_ptr<FrameSink> make(const SinkContext& context) const = 0;
};

}  // namespace bolo::pipeline

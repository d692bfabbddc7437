// A sink as a configuration has it: a section of keys, and the sink that they ask for.
#pragma once

#include <cstdint>
#include <memory>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "src/core/geometry.hpp"
#include "src/deblur/settings.hpp"
#include "src/model/strict_toml.hpp"
#include "src/pipeline/sink.hpp"

namespace bolo::pipeline {

// The daemon that a sink belongs to.
struct SinkContext {
  std::string name;            // the daemon's
  std::string control_socket;  // where it hears commands; empty: nowhere
  Geometry frame{};            // 0: not known yet
  deblur::Settings deblur{};
};

class SinkSection {
 public:
  virtual ~SinkSection() = default;

  // Declares the section and its keys, bound to this object, which outlives the table. Thread: any.
  virtual void declare(model::KeyTable& keys) = 0;

  // Paths of those keys that a running sink takes up (FrameSink::reload). Thread: any.
  virtual std::vector<std::string> live_keys() const { return {}; }

  // Checks the keys together, and beside the sections before this one; errors begin with the place in the file.
  // Thread: any.
  virtual Status check(const model::KeyTable& /*keys*/, const SinkContext& /*context*/,
                       std::span<const std::shared_ptr<SinkSection>> /*before*/) const {
    return {};
  }

  // As in SinkStatistics: the list in JSON is there, and empty, without a sink, too. Thread: any.
  virtual std::string_view group() const { return {}; }

  // "/dev/video10 (deblurred, y16)", for the log; empty when no sink is asked for. Thread: any.
  virtual std::string describe(const SinkContext& context) const = 0;

  // Bytes that it takes of /dev/shm. Thread: any.
  virtual std::uint64_t shared_bytes(const SinkContext& /*context*/) const { return 0; }

  // Null when none is asked for. Thread: setup.
  virtual std::unique_ptr<FrameSink> make(const SinkContext& context) const = 0;
};

}  // namespace bolo::pipeline

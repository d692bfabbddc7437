// Publishes frames into POSIX shared memory as include/bolo/shm_layout.h lays it out.
#pragma once

#include <cstdint>
#include <memory>
#include <string>

#include "src/pipeline/sink.hpp"

namespace bolo::shm {

struct ShmOptions {
  std::string name;              // the object is "/bolo." + name: letters, digits, '-', '_', '.'
  int slots = 0;                 // 0: a window of raw planes and some time to read them
  unsigned mode = 0640;          // permissions; readers need to read only
  std::string group;             // owner group of the object; empty: the process's
  std::string control_socket{};  // where the daemon hears commands, told to readers; empty: nowhere
};

// Checks the permissions, whatever the frames are. Thread: any.
Status check_mode(const ShmOptions& options);

// Bytes of the object for such frames; those of a ring of the least size where options.slots is out of range. Thread:
// any.
std::uint64_t bytes_needed(const ShmOptions& options, const deblur::Settings& settings, Geometry frame);

class ShmSink final : public pipeline::FrameSink {
 public:
  explicit ShmSink(ShmOptions options);
  ~ShmSink() override;

  Status open(const pipeline::SinkFormat& format) override;
  void publish(const pipeline::PublishedFrame& frame, const pipeline::PipelineStats& stats) noexcept override;
  void idle(const pipeline::PipelineStats& stats) noexcept override;
  void close() noexcept override;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace bolo::shm

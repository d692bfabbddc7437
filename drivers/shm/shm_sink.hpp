// Publishes frames into POSIX shared memory as include/bolo/shm_layout.h lays it out.
#pragma once

#include <memory>
#include <string>

#include "bolo/pipeline/sink.hpp"

namespace bolo::shm {

struct ShmOptions {
  std::string name;              // the object is "/bolo." + name: letters, digits, '-', '_', '.'
  int slots = 0;                 // 0: a window of raw planes and some time to read them
  unsigned mode = 0644;          // permissions; readers need to read only
  std::string group;             // owner group of the object; empty: the process's
  std::string control_socket{};  // where the daemon hears commands, told to readers; empty: nowhere
};

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

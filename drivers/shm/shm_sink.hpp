// Publishes frames to POSIX shared memory in the layout of include/bolo/shm_layout.h.
#pragma once

#include <atomic>
#include <cstdint>
#include <memory>
#include <string>
#include <thread>
#include <vector>

#include "src/pipeline/sink.hpp"

namespace bolo::shm {

// --- Wakes readers waiting on a futex in shared memory, at a bounded cost for the caller.
//
// Each woken process costs about 2 us, and any permitted reader may wait with any number of threads. So the caller
// wakes only a few, usually all, and a separate thread wakes the rest.

class Waker {
 public:
  // `word` must outlive this. Thread: setup.
  explicit Waker(std::uint32_t& word);
  ~Waker();

  // Wakes all waiters on the word, some a little later. Change the word first. Thread: pipeline.
  void wake() noexcept;

 private:
  void end() noexcept;
  void run() noexcept;

  std::uint32_t& word_;
  std::atomic<std::uint32_t> asked_{0};  // number of requests to wake the rest
  std::atomic<bool> ends_{false};
  std::thread thread_;
};

struct ShmOptions {
  std::string name;              // the object is "/bolo." + name: letters, digits, '-', '_', '.'
  int slots = 0;                 // 0: enough for a window of raw planes plus reading time
  unsigned mode = 0640;          // permissions; readers only need to read
  std::string group;             // owner group of the object; empty: the process's
  std::string control_socket{};  // of the daemon, for commands, published to readers; empty: none
};

// Checks options.mode only, without frames. Thread: any.
Status check_mode(const ShmOptions& options);

// Size of the object in bytes; for the smallest ring if options.slots is out of range. Thread: any.
std::uint64_t bytes_needed(const ShmOptions& options, const deblur::Settings& settings, Geometry frame);

class ShmSink final : public pipeline::FrameSink {
 public:
  explicit ShmSink(ShmOptions options);
  ~ShmSink() override;

  Status open(const pipeline::SinkFormat& format) override;
  void publish(const pipeline::PublishedFrame& frame, const pipeline::PipelineStats& stats) noexcept override;
  void idle(const pipeline::PipelineStats& stats) noexcept override;
  void close() noexcept override;
  // Also checks periodically that the name exists; a removed one is recreated with an empty ring, and readers follow.
  // Thread: any, but one at a time.
  std::vector<pipeline::Notice> take_notices() override;

 private:
  struct Ring;
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

// --- Configuration section of the shared memory.

class ShmSection final : public pipeline::SinkSection {
 public:
  bool enabled() const noexcept { return enabled_; }
  // As configured, without values from the context.
  const ShmOptions& options() const noexcept { return options_; }

  void declare(model::KeyTable& keys) override;
  Status check(const model::KeyTable& keys, const pipeline::SinkContext& context,
               std::span<const std::shared_ptr<SinkSection>> before) const override;
  std::string describe(const pipeline::SinkContext& context) const override;
  std::uint64_t shared_bytes(const pipeline::SinkContext& context) const override;
  std::unique_ptr<pipeline::FrameSink> make(const pipeline::SinkContext& context) const override;

 private:
  bool enabled_ = true;
  ShmOptions options_;
};

}  // namespace bolo::shm

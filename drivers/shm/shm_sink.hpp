// Publishes frames into POSIX shared memory as include/bolo/shm_layout.h lays it out.
#pragma once

#include <atomic>
#include <cstdint>
#include <memory>
#include <string>
#include <thread>
#include <vector>

#include "src/pipeline/sink.hpp"

namespace bolo::shm {

// --- Wakes the readers that wait on a futex in shared memory, at a cost that their number does not raise.
//
// A wake-up costs the caller some 2 us for each process that it wakes, and anybody who may read may wait, with as many
// threads as he likes. So the caller itself wakes a few, which are all there usually are; a thread of its own wakes the
// rest.

class Waker {
 public:
  // `word` must outlive this. Thread: setup.
  explicit Waker(std::uint32_t& word);
  ~Waker();

  // Wakes all that wait on the word, some of them a little later. The word was changed before. Thread: pipeline.
  void wake() noexcept;

 private:
  void end() noexcept;
  void run() noexcept;

  std::uint32_t& word_;
  std::atomic<std::uint32_t> asked_{0};  // times that there was a rest to wake
  std::atomic<bool> ends_{false};
  std::thread thread_;
};

struct ShmOptions {
  std::string name;              // the object is "/bolo." + name: letters, digits, '-', '_', '.'
  int slots = 0;                 // 0: a window of raw planes and some time to read them
  unsigned mode = 0640;          // permissions; readers need to read only
  std::string group;             // owner group of the object; empty: the process's
  std::string control_socket{};  // of the daemon, for commands, published to readers; empty: none
};

// Checks the permissions, which need no frames. Thread: any.
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
  // Looks now and then whether the name is there; where it was taken away, it comes back with an empty ring, to which
  // readers go on. Thread: any, but one at a time.
  std::vector<pipeline::Notice> take_notices() override;

 private:
  struct Ring;
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

// --- The section of keys of the shared memory.

class ShmSection final : public pipeline::SinkSection {
 public:
  bool enabled() const noexcept { return enabled_; }
  // As given, without what comes from the context.
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

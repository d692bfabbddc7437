// The section of keys of the shared memory.
#pragma once

#include "drivers/shm/shm_sink.hpp"
#include "src/pipeline/sink_section.hpp"

namespace bolo::shm {

class ShmSection final : public pipeline::SinkSection {
 public:
  bool enabled() const noexcept { return enabled_; }
  // As asked for, without what the context tells.
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

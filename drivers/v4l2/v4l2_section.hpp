// The section of keys of one video device.
#pragma once

#include "drivers/v4l2/v4l2_sink.hpp"
#include "src/pipeline/sink_section.hpp"

namespace bolo::v4l2 {

class V4l2Section final : public pipeline::SinkSection {
 public:
  // `options`: the defaults.
  V4l2Section(std::string name, std::string meaning, V4l2Options options = {});

  bool enabled() const noexcept { return enabled_; }
  const V4l2Options& options() const noexcept { return options_; }

  void declare(model::KeyTable& keys) override;
  std::vector<std::string> live_keys() const override;
  Status check(const model::KeyTable& keys, const pipeline::SinkContext& context,
               std::span<const std::shared_ptr<SinkSection>> before) const override;
  std::string_view group() const override { return "video"; }
  std::string describe(const pipeline::SinkContext& context) const override;
  std::unique_ptr<pipeline::FrameSink> make(const pipeline::SinkContext& context) const override;

 private:
  std::string name_;
  std::string meaning_;
  bool enabled_ = false;
  V4l2Options options_;
};

}  // namespace bolo::v4l2

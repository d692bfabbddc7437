// Frames as a video device: programs that know cameras, but nothing of Bolo, read it.
#pragma once

#include <future>
#include <memory>
#include <string>
#include <thread>
#include <vector>

#include "drivers/v4l2/image.hpp"
#include "drivers/v4l2/video_port.hpp"
#include "src/pipeline/notices.hpp"
#include "src/pipeline/sink.hpp"
#include "src/rt/counters.hpp"

namespace bolo::v4l2 {

enum class Plane { kRaw, kDeblurred };

struct V4l2Options {
  std::string device = "/dev/video10";
  Plane plane = Plane::kDeblurred;
  PixelFormat format = PixelFormat::kY16;
  Y16Unit y16_unit = Y16Unit::k10mK;
  AgcOptions agc{};
};

// Since open(). Written by the sink's threads, read by any.
struct V4l2Stats {
  rt::Counter written;         // frames that the device took
  rt::Counter dropped;         // frames that it did not: it was busy or gone, or a newer one came first
  rt::Counter failures;        // times that the device failed and was let go
  rt::Gauge<bool> open{true};  // now
};

// Writes on a thread of its own (bolo-v4l2): always the newest frame, so that a device that is slow, stuck or gone
// holds up nobody. One that fails is opened again, after half a second at first and every five at last. The format is
// the same for the life of the sink. Nothing is allocated between open() and a failure of the device.
class V4l2Sink final : public pipeline::FrameSink {
 public:
  // Writes to options.device.
  explicit V4l2Sink(V4l2Options options);
  // The same through another port, which the sink comes to own.
  V4l2Sink(V4l2Options options, std::unique_ptr<VideoPort> port);
  ~V4l2Sink() override;

  // A device that is missing, or no v4l2loopback, is bad input, with the command that makes one.
  Status open(const pipeline::SinkFormat& format) override;
  void publish(const pipeline::PublishedFrame& frame, const pipeline::PipelineStats& stats) noexcept override;
  // Waits two seconds at most for a device that is stuck in a write.
  void close() noexcept override;

  pipeline::SinkStatistics statistics() const override;
  // Changes of the device.
  std::vector<pipeline::Notice> take_notices() override;
  // Takes the AGC, from the next frame on.
  void reload(const pipeline::SinkSection& read) override;

  // Thread: any.
  const V4l2Stats& stats() const noexcept;

 private:
  struct Impl;
  std::shared_ptr<Impl> impl_;  // shared with the thread, which a stuck device may keep beyond the sink
  std::thread thread_;
  std::future<void> ended_;
};

// --- The section of keys of one video device.

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

// Publishes frames as a video device, for camera programs that know nothing of Bolo.
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
  rt::Counter written;         // frames that the device accepted
  rt::Counter dropped;         // frames not accepted: device busy or gone, or replaced by a newer frame
  rt::Counter failures;        // times that the device failed and was closed
  rt::Gauge<bool> open{true};  // current state
};

// Writes on its own thread (bolo-v4l2), always the newest frame, so that a slow, stuck or missing device delays nobody.
// A failed device is reopened after half a second at first, every five seconds at most. The format stays the same for
// the life of the sink. No allocation between open() and a failure of the device.
class V4l2Sink final : public pipeline::FrameSink {
 public:
  // Writes to options.device.
  explicit V4l2Sink(V4l2Options options);
  // Writes to another port, for tests.
  V4l2Sink(V4l2Options options, std::unique_ptr<VideoPort> port);
  ~V4l2Sink() override;

  // kBadInput, with the command that creates the device: it is missing, or not of v4l2loopback.
  Status open(const pipeline::SinkFormat& format) override;
  void publish(const pipeline::PublishedFrame& frame, const pipeline::PipelineStats& stats) noexcept override;
  // Waits at most two seconds for a device that is stuck in a write.
  void close() noexcept override;

  pipeline::SinkStatistics statistics() const override;
  std::vector<pipeline::Notice> take_notices() override;
  // Applies the AGC options from the next frame on.
  void reload(const pipeline::SinkSection& read) override;

  // Thread: any.
  const V4l2Stats& stats() const noexcept;

 private:
  struct Impl;
  std::shared_ptr<Impl> impl_;  // shared with the thread, which may outlive the sink when the device is stuck
  std::thread thread_;
  std::future<void> ended_;
};

// --- Configuration section of one video device.

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

// V4L2 cameras that send 16 bits per pixel: Boson, Lepton by PureThermal, cores of the Tiny1 class.
#pragma once

#include <linux/videodev2.h>

#include <cstdint>
#include <memory>
#include <string>

#include "drivers/v4l2_source/video_system.hpp"
#include "src/pipeline/source.hpp"

namespace bolo::v4l2_source {

// Part of the error message for a busy device.
inline constexpr const char* kInUse = "another program uses it";

// Image rows within the device's frames; the others are metadata or another image.
struct Rows {
  int first = 0;
  int count = 0;  // 0: all rows from `first`
};

struct V4l2SourceOptions {
  std::string device = "/dev/video0";  // or the serial number of its USB device
  // V4L2_PIX_FMT_*, 16 bits per pixel, little-endian, values unchanged; YUYV: cores with stacked images send 16-bit
  // data under this name.
  std::uint32_t format = V4L2_PIX_FMT_Y16;
  Rows rows{};
  LinearScale scale{Unit::kCount, 1.0, 0.0};
  double frame_period_s = 1.0 / 60.0;  // if the driver does not state it
  int buffers = 8;
  int realtime_priority = 0;      // SCHED_FIFO priority of the receiving thread; 0: the default scheduler
  int stall_ms = 200;             // stalled: no frame for this long and for 20 frame periods
  int reconnect_after_ms = 2000;  // reopened when stalled for this long; 0: never. A disconnected one: at once
};

class V4l2Source final : public pipeline::FrameSource {
 public:
  explicit V4l2Source(V4l2SourceOptions options, VideoSystem& system = kernel_video());
  ~V4l2Source() override;

  // kBadInput: no such device, one in use by another program, or one that does not support the requested format.
  Result<pipeline::SourceInfo> open() override;
  // Reopens a lost camera until stop(), by its serial number if it has one; its first frame then starts a new window.
  Status start(pipeline::FrameInlet& inlet) override;
  void stop() noexcept override;

  const pipeline::SourceStatus* status() const noexcept override;
  std::vector<pipeline::Notice> take_notices() override;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace bolo::v4l2_source

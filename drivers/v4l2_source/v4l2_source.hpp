// Cameras that the kernel knows as video devices (V4L2) and that send 16 bits a pixel: Boson, Lepton by PureThermal,
// cores of the Tiny1 class.
#pragma once

#include <linux/videodev2.h>

#include <cstdint>
#include <memory>
#include <string>

#include "drivers/v4l2_source/video_system.hpp"
#include "src/pipeline/source.hpp"

namespace bolo::v4l2_source {

// Part of the errors about a device that another program has.
inline constexpr const char* kInUse = "another program uses it";

// Rows of the device's frames that are the image: those before and after are metadata, or another image.
struct Rows {
  int first = 0;
  int count = 0;  // 0: all from the first on
};

struct V4l2SourceOptions {
  std::string device = "/dev/video0";  // or the serial number of its USB device
  // V4L2_PIX_FMT_*, 16 bits a pixel, low byte first, values taken as they are; YUYV: in the name of a colour format, as
  // cores with stacked images send them.
  std::uint32_t format = V4L2_PIX_FMT_Y16;
  Rows rows{};
  LinearScale scale{Unit::kCount, 1.0, 0.0};
  double frame_period_s = 1.0 / 60.0;  // where the driver does not state it
  int buffers = 8;
  int realtime_priority = 0;      // SCHED_FIFO, of the receiving thread; 0: the default scheduler
  int stall_ms = 200;             // without a frame for this long, and for 20 frame periods: stalled
  int reconnect_after_ms = 2000;  // stalled for this long it is opened again; 0: never. One that is gone: at once
};

class V4l2Source final : public pipeline::FrameSource {
 public:
  explicit V4l2Source(V4l2SourceOptions options, VideoSystem& system = kernel_video());
  ~V4l2Source() override;

  // kBadInput: no such device, one that another program uses, or one that does not send what was asked for.
  Result<pipeline::SourceInfo> open() override;
  // A camera that is lost is opened again in the background until stop(), by its serial number where it has one, and
  // its first frame then starts a new window.
  Status start(pipeline::FrameInlet& inlet) override;
  void stop() noexcept override;

  const pipeline::SourceStatus* status() const noexcept override;
  std::vector<pipeline::Notice> take_notices() override;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace bolo::v4l2_source

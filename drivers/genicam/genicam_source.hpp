// A GigE Vision or USB3 Vision camera through Aravis.
#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <string>

#include "bolo/pipeline/source.hpp"

namespace bolo::genicam {

enum class PixelOrder { kLittleEndian, kBigEndian };

// What FLIR calls IRFormat: what a count means.
enum class IrFormat { kLeave, kRadiometric, kTemperatureLinear100mK, kTemperatureLinear10mK };

struct CameraOptions {
  std::string address;   // IP address, or Aravis device id; empty: the only camera that answers
  int width = 0;         // 0: leave as the camera has it
  int height = 0;        // image rows, without metadata rows
  double rate_hz = 0.0;  // 0: leave; also the frame period when the camera does not say
  IrFormat ir_format = IrFormat::kTemperatureLinear10mK;
  PixelOrder pixel_order = PixelOrder::kLittleEndian;
  int metadata_rows = 0;  // rows after the image that are dropped
  int packet_size = 0;    // bytes, 0: the largest that the link carries
  int socket_buffer_bytes = 8 << 20;
  bool resend = false;  // ask for lost packets again
  int packet_timeout_us = 2000;
  int frame_retention_us = 10000;  // how long an incomplete frame may hold up the ones behind it
  int buffers = 48;
  int realtime_priority = 0;  // of Aravis's receiving thread
};

class GenicamSource final : public pipeline::FrameSource {
 public:
  explicit GenicamSource(CameraOptions options);
  ~GenicamSource() override;

  Result<pipeline::SourceInfo> open() override;
  Status start(pipeline::FrameInlet& inlet) override;
  void stop() noexcept override;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace bolo::genicam

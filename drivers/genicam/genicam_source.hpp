// A GigE Vision or USB3 Vision camera through Aravis.
#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "src/pipeline/source.hpp"

namespace bolo::genicam {

enum class PixelOrder { kLittleEndian, kBigEndian };

// Meaning of a count (FLIR: IRFormat).
enum class IrFormat { kLeave, kRadiometric, kTemperatureLinear100mK, kTemperatureLinear10mK };

// Trigger of a NUC (non-uniformity correction: the camera closes its shutter and corrects its pixels).
enum class NucPolicy {
  kCamera,  // by the camera, at times unknown here
  kManual,  // only on request
  kTimed,   // at an interval
  kStill,   // when the scene stands still, at most once per interval
};

struct NucOptions {
  NucPolicy policy = NucPolicy::kCamera;
  double interval_s = 300.0;  // timed, still
  double still_s = 2.0;       // minimum time without motion
  double still_k = 0.1;       // smaller mean changes are no motion; K (counts without kelvin)
  int hold_ms = 500;          // frames of this time after the command count as shutter frames
};

// Parameters of the measured object, for the camera or radiometric counts. Unset ones keep the camera's value.
struct ObjectParameters {
  double emissivity = 1.0;
  double transmission = 1.0;         // of the air
  double optics_transmission = 1.0;  // of a window before the lens
  std::optional<double> reflected_k;
  std::optional<double> atmosphere_k;
  std::optional<double> optics_k;
  std::optional<double> distance_m;
  std::optional<double> humidity;  // 0 to 1
};

// Bytes, including IP and UDP headers: supported by every camera and link.
inline constexpr int kSmallestPacket = 576;

struct CameraOptions {
  std::string address;        // IP address, or Aravis device id; empty: the only camera that answers
  std::string serial;         // empty: any. Identifies a lost camera that is no longer at its address
  int width = 0;              // 0: keep the camera's
  int height = 0;             // image rows, without metadata rows
  double rate_hz = 0.0;       // 0: keep; also the frame period if the camera does not state it
  double true_rate_hz = 0.0;  // actual rate, if the camera states a wrong one; 0: as stated
  IrFormat ir_format = IrFormat::kTemperatureLinear10mK;
  PixelOrder pixel_order = PixelOrder::kLittleEndian;
  int metadata_rows = 0;  // dropped rows after the image
  int packet_size = 0;    // bytes, at least kSmallestPacket; 0: the largest that the link carries
  int socket_buffer_bytes = 8 << 20;
  bool resend = false;  // request lost packets again
  bool ptp = false;     // enable PTP (IEEE 1588); false: keep the camera's setting
  int packet_timeout_us = 2000;
  // Maximum time that an incomplete frame delays later ones. Without resends it delays none, and is kept for 100 ms.
  int frame_retention_us = 10000;
  int buffers = 48;
  int realtime_priority = 0;      // SCHED_FIFO priority of the receiving thread; 0: nice level -10, if allowed
  int windowing_watch_ms = 1000;  // after a change of windowing: time to watch for a dropped connection
  int stall_ms = 200;             // stalled: no frame for this long and for 20 frame periods
  // A stalled camera that does not answer, or that another program controls, is reopened at once; one that answers but
  // sends nothing, after this time. 0: never.
  int reconnect_after_ms = 2000;
  double range_low_k = 0.0;   // selects a range ("case") that includes these temperatures;
  double range_high_k = 0.0;  // 0: keep the camera's
  NucOptions nuc;
  ObjectParameters object;
};

using pipeline::SourceState;

class ConnectionManager;

struct FoundCamera {
  std::string id;  // Aravis id: "FLIR Systems-A655sc-12345"
  std::string model;
  std::string serial;
  std::string address;  // IP address, or the transport's equivalent
};

// Broadcasts on every interface and waits about a second for answers. Thread: setup.
std::vector<FoundCamera> find_cameras();

// Version of Aravis at run time, "0.8.26". Thread: any.
std::string aravis_version();

class GenicamSource final : public pipeline::FrameSource {
 public:
  explicit GenicamSource(CameraOptions options);
  // Stops. Blocks at most a few seconds, even when the camera is dead.
  ~GenicamSource() override;
  GenicamSource(const GenicamSource&) = delete;
  GenicamSource& operator=(const GenicamSource&) = delete;

  // kBadInput: no camera, several cameras without an address, a camera controlled by another program, or one that
  // refuses a setting that the stream depends on. Rounded settings are in warnings(). Thread: setup.
  Result<pipeline::SourceInfo> open() override;

  // Call once. Frames arrive on the receiving thread. A lost camera is reopened in the background until stop(); its
  // first frame then starts a new window. Thread: setup.
  Status start(pipeline::FrameInlet& inlet) override;

  // Waits only a bounded time for a teardown that the camera does not answer. Thread: setup.
  void stop() noexcept override;

  const pipeline::SourceStatus* status() const noexcept override;
  // Thread: any.
  SourceState state() const noexcept { return status()->state.value(); }
  // Blocks at most 5 s. Frames during hold_ms afterwards carry kFlagNuc; a new window begins before and after them.
  Status trigger_nuc() override;
  // Changes the NUC policy of a started camera; warnings become notices. Thread: any.
  void set_nuc(const NucOptions& nuc);
  // Number of reconnects. Thread: any.
  std::uint64_t reconnects() const noexcept { return status()->reopened.value(); }
  // Settings that the camera or the host rounded or refused during open() and start(). Thread: any.
  std::vector<std::string> warnings() const;
  std::vector<pipeline::Notice> take_notices() override;

 private:
  const std::shared_ptr<ConnectionManager> manager_;
};

}  // namespace bolo::genicam

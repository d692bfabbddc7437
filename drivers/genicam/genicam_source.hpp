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

// Meaning of a count; FLIR calls it IRFormat.
enum class IrFormat { kLeave, kRadiometric, kTemperatureLinear100mK, kTemperatureLinear10mK };

// Trigger of a NUC (non-uniformity correction: the camera closes its shutter and corrects its pixels).
enum class NucPolicy {
  kCamera,  // the camera itself; its times are not known here
  kManual,  // only when asked
  kTimed,   // at an interval
  kStill,   // when the scene stands still, at an interval at least
};

struct NucOptions {
  NucPolicy policy = NucPolicy::kCamera;
  double interval_s = 300.0;  // timed, still
  double still_s = 2.0;       // how long nothing may have moved
  double still_k = 0.1;       // a change by less than this, on average, is none; K (counts without kelvin)
  int hold_ms = 500;          // frames of this time after the command are taken to be those of the shutter
};

// Parameters of the measured object, written to the camera or used for radiometric counts. Those without a value are
// left as the camera has them.
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

// Bytes, with IP and UDP headers: every camera and every link carries as many.
inline constexpr int kSmallestPacket = 576;

struct CameraOptions {
  std::string address;        // IP address, or Aravis device id; empty: the only camera that answers
  std::string serial;         // empty: any. A lost camera that is not at its address any more is looked for by it
  int width = 0;              // 0: leave as the camera has it
  int height = 0;             // image rows, without metadata rows
  double rate_hz = 0.0;       // 0: leave; also the frame period when the camera does not state it
  double true_rate_hz = 0.0;  // actual rate, where the camera states another; 0: as stated
  IrFormat ir_format = IrFormat::kTemperatureLinear10mK;
  PixelOrder pixel_order = PixelOrder::kLittleEndian;
  int metadata_rows = 0;  // rows after the image that are dropped
  int packet_size = 0;    // bytes, kSmallestPacket or more; 0: the largest that the link carries
  int socket_buffer_bytes = 8 << 20;
  bool resend = false;  // ask for lost packets again
  bool ptp = false;     // switch PTP (IEEE 1588) on; false: leave it as the camera has it
  int packet_timeout_us = 2000;
  // Limit of the time that an incomplete frame delays the ones behind it. Without resends it delays none, and waits
  // 100 ms.
  int frame_retention_us = 10000;
  int buffers = 48;
  int realtime_priority = 0;      // SCHED_FIFO, of the receiving thread; 0: nice level -10, as far as that is allowed
  int windowing_watch_ms = 1000;  // after another windowing, how long the camera is watched for dropping the connection
  int stall_ms = 200;             // without a frame for this long, and for 20 frame periods: stalled
  // A stalled camera that does not answer, or that another program controls, is lost and opened again at once; one that
  // answers and only sends nothing, after this time. 0: it is never opened again.
  int reconnect_after_ms = 2000;
  double range_low_k = 0.0;   // a range ("case") that holds these temperatures is chosen;
  double range_high_k = 0.0;  // 0: the camera's own is left
  NucOptions nuc;
  ObjectParameters object;
};

using pipeline::SourceState;

class ConnectionManager;

struct FoundCamera {
  std::string id;  // Aravis's: "FLIR Systems-A655sc-12345"
  std::string model;
  std::string serial;
  std::string address;  // IP address, or what the transport has instead
};

// Asks every interface and waits for answers, about a second. Thread: setup.
std::vector<FoundCamera> find_cameras();

// Version of Aravis as it runs, "0.8.26". Thread: any.
std::string aravis_version();

class GenicamSource final : public pipeline::FrameSource {
 public:
  explicit GenicamSource(CameraOptions options);
  // Stops. Blocks a few seconds at most, also when the camera is dead.
  ~GenicamSource() override;
  GenicamSource(const GenicamSource&) = delete;
  GenicamSource& operator=(const GenicamSource&) = delete;

  // kBadInput: no camera, several cameras without an address, a camera that another program controls, or one that
  // refuses a setting that the stream depends on. Settings that were rounded are in warnings(). Thread: setup.
  Result<pipeline::SourceInfo> open() override;

  // Once. Frames come on the receiving thread; a camera that is lost is opened again in the background until stop(),
  // and its first frame then starts a new window. Thread: setup.
  Status start(pipeline::FrameInlet& inlet) override;

  // Waits for a teardown that the camera does not answer for a bounded time only. Thread: setup.
  void stop() noexcept override;

  const pipeline::SourceStatus* status() const noexcept override;
  // Thread: any.
  SourceState state() const noexcept { return status()->state.value(); }
  // Blocks 5 s at most. Frames of the time after it carry kFlagNuc, and a new window begins before and after them.
  Status trigger_nuc() override;
  // Another policy for the corrections of a camera that was started; warnings are notices. Thread: any.
  void set_nuc(const NucOptions& nuc);
  // Times that a lost camera was opened again. Thread: any.
  std::uint64_t reconnects() const noexcept { return status()->reopened.value(); }
  // Settings that the camera or the host rounded or refused when it was opened and started. Thread: any.
  std::vector<std::string> warnings() const;
  std::vector<pipeline::Notice> take_notices() override;

 private:
  const std::shared_ptr<ConnectionManager> manager_;
};

}  // namespace bolo::genicam

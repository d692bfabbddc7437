// Interface of a source of frames: a camera, a fake camera, a capture.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

#include "bolo/shm_layout.h"
#include "src/core/frame.hpp"
#include "src/core/result.hpp"
#include "src/pipeline/counter_row.hpp"
#include "src/pipeline/inlet.hpp"
#include "src/pipeline/notices.hpp"
#include "src/rt/counters.hpp"

namespace bolo::pipeline {

// --- Status of a camera that is monitored, readable while it runs, and the row of each number.

// The values are part of the shared-memory layout (shm_layout.h): append only.
enum class SourceState : std::uint32_t {
  kIdle,        // not started, or stopped
  kStreaming,   // frames arrive
  kStalled,     // connected, but frames have stopped
  kLost,        // the connection is gone; it is being reopened
  kCorrecting,  // the camera closes its shutter and corrects its pixels (NUC)
  kCount
};

// Cause of a camera's loss. The order is part of the shared-memory layout: append only.
enum class LostCause : std::size_t {
  kControlLost,  // it answers, but no longer obeys this program: rebooted, or taken by another
  kNoAnswer,     // unplugged, switched off, frozen, or under another address
  kStalled,      // it answers and obeys, yet sends no frames
  kCount
};

// Synchronisation of the camera's clock: PTP's port states, numbered as in IEEE 1588-2019, table 20.
enum class PtpStatus : std::uint32_t {
  kOff,  // or unknown
  kInitializing,
  kFaulty,
  kDisabled,
  kListening,
  kPreMaster,
  kMaster,
  kPassive,
  kUncalibrated,
  kSlave,  // it follows a master
  kCount
};

inline constexpr std::size_t kPtpStatuses = static_cast<std::size_t>(PtpStatus::kCount);
inline constexpr std::size_t kSourceStates = static_cast<std::size_t>(SourceState::kCount);
inline constexpr std::size_t kLostCauses = static_cast<std::size_t>(LostCause::kCount);

// Names as `bolo stat`, JSON and the log print them. Thread: any.
constexpr std::string_view name(SourceState state) {
  constexpr std::array<std::string_view, kSourceStates> kNames{"idle", "streaming", "stalled", "lost", "correcting"};
  return kNames[static_cast<std::size_t>(state)];
}
constexpr std::string_view name(LostCause cause) {
  constexpr std::array<std::string_view, kLostCauses> kNames{"control lost", "no answer", "stalled"};
  return kNames[static_cast<std::size_t>(cause)];
}
constexpr std::string_view name(PtpStatus status) {
  constexpr std::array<std::string_view, kPtpStatuses> kNames{"off",          "initializing", "faulty", "disabled",
                                                              "listening",    "pre-master",   "master", "passive",
                                                              "uncalibrated", "slave"};
  return kNames[static_cast<std::size_t>(status)];
}

// Since the source was created. Written by the source's threads, read by any; each value is independent.
struct SourceStatus {
  rt::Gauge<SourceState> state{SourceState::kIdle};
  rt::Gauge<std::int64_t> since_ns;           // CLOCK_MONOTONIC, start of this state
  rt::Gauge<std::int64_t> watched_ns;         // CLOCK_MONOTONIC of the source's last check of its camera
  std::array<rt::Counter, kLostCauses> lost;  // times that the camera was lost, by cause
  rt::Counter reopened;                       // times that it was opened again
  rt::Counter stalls;                         // times that frames stopped
  rt::Counter outage_frames;                  // frames that it would have sent while lost; not among the losses
  rt::Counter corrections;                    // NUCs requested by this program
  rt::Gauge<std::int64_t> correction_ns;      // CLOCK_MONOTONIC of the last one; 0: none
  rt::Gauge<std::int64_t> clock_offset_ns;    // host's clock - camera's, now; 0: not known yet
  rt::Gauge<double> clock_drift_ppm;          // positive: the camera's clock is slower than the host's
  rt::Gauge<double> clock_jitter_ns;          // of the latency from camera to host, rms above its shortest
  rt::Counter clock_jumps;                    // of the camera's clock
  rt::Gauge<double> measured_period_s;        // from frame to frame by the camera's clock; 0: not known yet
  rt::Counter received_packets;               // datagrams of the stream; only for GigE Vision, like the next two
  rt::Counter missing_packets;                // of frames that were abandoned
  rt::Counter resent_packets;                 // that arrived after a resend request
  rt::Gauge<double> temperature_k;            // of the camera; 0: not known
  rt::Gauge<PtpStatus> ptp{PtpStatus::kOff};
  rt::Gauge<std::int64_t> ptp_offset_ns;  // from its PTP master, by the camera's own estimate
};

using CameraRow = CounterRow<SourceStatus>;
inline constexpr std::array kCameraCounters{
    CameraRow(word_of<&SourceStatus::state>, offsetof(bolo_shm_camera, state)),
    CameraRow(word_of<&SourceStatus::since_ns>, offsetof(bolo_shm_camera, since_ns)),
    CameraRow(word_of<&SourceStatus::lost>, offsetof(bolo_shm_camera, lost), "lost", "bolo_camera_lost_total",
              "Times that the camera was given up, by cause", by<LostCause>("cause", kLostCauses)),
    CameraRow(word_of<&SourceStatus::reopened>, offsetof(bolo_shm_camera, reopened), "reopened",
              "bolo_camera_reconnects_total", "Times that it was opened again"),
    CameraRow(word_of<&SourceStatus::stalls>, offsetof(bolo_shm_camera, stalls), "stalls", "bolo_camera_stalls_total",
              "Times that frames stopped"),
    CameraRow(word_of<&SourceStatus::outage_frames>, offsetof(bolo_shm_camera, outage_frames), "outage_frames",
              "bolo_camera_outage_frames_total", "Frames that would have come while it was lost"),
    CameraRow(word_of<&SourceStatus::corrections>, offsetof(bolo_shm_camera, corrections), "nucs",
              "bolo_camera_corrections_total", "Corrections of its pixels (NUC) that were asked for"),
    CameraRow(word_of<&SourceStatus::correction_ns>, offsetof(bolo_shm_camera, correction_ns), "nuc_age_s", "", "",
              Reading{RowKind::kSince}),
    CameraRow(word_of<&SourceStatus::clock_offset_ns>, offsetof(bolo_shm_camera, clock_offset_ns), "clock_offset_s", "",
              "", Reading{RowKind::kNs, 1e-9}),
    CameraRow(word_of<&SourceStatus::clock_drift_ppm>, offsetof(bolo_shm_camera, clock_drift_ppm), "clock_drift_ppm",
              "bolo_camera_clock_drift_ratio", "By how much its clock is slower than the host's",
              Reading{RowKind::kReal, 1.0, 1e-6, offsetof(bolo_shm_camera, clock_offset_ns)}),
    CameraRow(word_of<&SourceStatus::clock_jitter_ns>, offsetof(bolo_shm_camera, clock_jitter_ns), "clock_jitter_ms",
              "bolo_camera_clock_jitter_seconds", "Of the way from camera to host, rms over its shortest",
              Reading{RowKind::kReal, 1e-6, 1e-9, offsetof(bolo_shm_camera, clock_offset_ns)}),
    CameraRow(word_of<&SourceStatus::clock_jumps>, offsetof(bolo_shm_camera, clock_jumps), "clock_jumps",
              "bolo_camera_clock_jumps_total", "Jumps of its clock"),
    CameraRow(word_of<&SourceStatus::received_packets>, offsetof(bolo_shm_camera, received_packets), "received_packets",
              "bolo_camera_packets_received_total", "Packets, as the transport counts them", InStat{"received"}),
    CameraRow(word_of<&SourceStatus::missing_packets>, offsetof(bolo_shm_camera, missing_packets), "missing_packets",
              "bolo_camera_packets_missing_total", "Packets that never came", InStat{"missing"}),
    CameraRow(word_of<&SourceStatus::resent_packets>, offsetof(bolo_shm_camera, resent_packets), "resent_packets",
              "bolo_camera_packets_resent_total", "Packets that came when asked for again", InStat{"sent again"}),
    CameraRow(word_of<&SourceStatus::temperature_k>, offsetof(bolo_shm_camera, temperature_k), "temperature_k", "", "",
              Reading{RowKind::kReal}),
    CameraRow(word_of<&SourceStatus::ptp>, offsetof(bolo_shm_camera, ptp)),
    CameraRow(word_of<&SourceStatus::ptp_offset_ns>, offsetof(bolo_shm_camera, ptp_offset_ns), "ptp_offset_s", "", "",
              Reading{RowKind::kNs, 1e-9, 1.0, offsetof(bolo_shm_camera, ptp)}),
};

struct WatchLimits {
  std::int64_t stall_ns;  // without a frame for this long: stalled
  std::int64_t lost_ns;   // ... and for this long: lost
};

// From the configuration, but at least 20 frame periods. Thread: any.
WatchLimits watch_limits(int stall_ms, int reconnect_after_ms, double period_s) noexcept;

// Frames that would have come between the last one before an outage and the first one after it. Thread: any.
std::uint64_t frames_between(std::int64_t last_ns, std::int64_t first_ns, double period_s) noexcept;

// By the camera's clock, or the stated period while that is unknown. Thread: any.
double known_period_s(const SourceStatus& status, double stated_s) noexcept;

struct SourceInfo {
  StreamFormat format;
  std::string camera_model;
  std::string camera_serial;
};

class FrameSource {
 public:
  virtual ~FrameSource() = default;

  // Connects, configures, and returns the format of the frames. Called once. Thread: setup.
  virtual Result<SourceInfo> open() = 0;

  // Starts to deliver frames into the inlet, from one thread of its own; the inlet outlives stop(). Thread: setup.
  virtual Status start(FrameInlet& inlet) = 0;

  // No frame is delivered after it returns. Idempotent. Thread: setup.
  virtual void stop() noexcept = 0;

  // Status of a monitored source, valid as long as the source; null for others. Thread: any.
  virtual const SourceStatus* status() const noexcept { return nullptr; }

  // Events since the last call, newest last. Thread: any.
  virtual std::vector<Notice> take_notices() { return {}; }

  // Starts a NUC (non-uniformity correction). Blocks until the camera has accepted the command. Thread: any.
  virtual Status trigger_nuc() { return failed("this source has no pixels to correct"); }
};

}  // namespace bolo::pipeline

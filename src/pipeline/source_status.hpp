// Status of a camera that is monitored, readable while it runs.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <string_view>

#include "src/rt/counters.hpp"

namespace bolo::pipeline {

// Relative: two periods that differ by less are the same to the sharp frames.
inline constexpr double kSamePeriod = 0.005;

// The values are part of the shared-memory layout (shm_layout.h): append only.
enum class SourceState : std::uint32_t {
  kIdle,        // not started, or stopped
  kStreaming,   // frames arrive
  kStalled,     // connected, but frames have stopped
  kLost,        // the connection is gone; it is being reopened
  kCorrecting,  // the camera closes its shutter and corrects its pixels (NUC)
  kCount
};

// Cause of the loss of a camera. The order is part of the shared-memory layout: append only.
enum class LostCause : std::size_t {
  kControlLost,  // it answers, but does not obey this program any more: rebooted, or taken by another
  kNoAnswer,     // unplugged, switched off, frozen, or under another address
  kStalled,      // it answers and obeys, yet sends no frames
  kCount
};

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

// Since the source was made. Written by the source's threads, read by any; each value stands alone.
struct SourceStatus {
  rt::Gauge<SourceState> state{SourceState::kIdle};
  rt::Gauge<std::int64_t> since_ns;           // CLOCK_MONOTONIC, when it came to this state
  rt::Gauge<std::int64_t> watched_ns;         // CLOCK_MONOTONIC, when the source last checked its camera
  std::array<rt::Counter, kLostCauses> lost;  // times that the camera was lost, by cause
  rt::Counter reopened;                       // times that it was opened again
  rt::Counter stalls;                         // times that frames stopped
  rt::Counter outage_frames;                  // that would have come while it was lost; not among the losses
  rt::Counter corrections;                    // NUCs that this program asked for
  rt::Gauge<std::int64_t> correction_ns;      // CLOCK_MONOTONIC of the last one; 0: none
  rt::Gauge<std::int64_t> clock_offset_ns;    // host's clock - camera's, now; 0: not known yet
  rt::Gauge<double> clock_drift_ppm;          // by how much the camera's clock is slower than the host's
  rt::Gauge<double> clock_jitter_ns;          // of the way from camera to host, rms over its shortest
  rt::Counter clock_jumps;                    // of the camera's clock
  rt::Gauge<double> measured_period_s;        // from frame to frame by the camera's clock; 0: not known yet
  rt::Gauge<std::uint64_t> received_packets;  // as the transport counts them
  rt::Gauge<std::uint64_t> missing_packets;   //
  rt::Gauge<std::uint64_t> resent_packets;    //
  rt::Gauge<double> temperature_k;            // of the camera; 0: not known
};

}  // namespace bolo::pipeline

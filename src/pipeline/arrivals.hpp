// Numbers, losses and times of the frames that a camera sends: what every source of live frames keeps of them.
#pragma once

#include <array>
#include <cstdint>

#include "src/pipeline/frame_id_tracker.hpp"
#include "src/pipeline/host_clock.hpp"
#include "src/pipeline/inlet.hpp"
#include "src/pipeline/source_status.hpp"

namespace bolo::pipeline {

// Outlives a source's connections. Thread: acquire, or setup while no connection delivers. No allocation.
class Arrivals {
 public:
  // Both outlive this.
  Arrivals(FrameInlet& inlet, SourceStatus& status) noexcept;

  // The tracker of frame numbers; what it counts as lost reaches the inlet with post_losses().
  FrameIdTracker ids;

  // Another connection's frames follow: neither its counter nor its clock goes on from the last one's.
  void restart() noexcept;

  // When a frame was taken, on CLOCK_MONOTONIC, by the camera's clock; publishes the state of both clocks, and begins
  // a new window where the camera's counter or clock has jumped. receive_ns: CLOCK_MONOTONIC.
  std::int64_t map_time(const FrameIdTracker::Verdict& verdict, std::int64_t camera_ns,
                        std::int64_t receive_ns) noexcept;

  // The inlet's counters are read while the stream runs; the tracker's are not.
  void post_losses() noexcept;
  // The last frame has come: what is still missing is lost.
  void finish() noexcept;

 private:
  FrameInlet& inlet_;
  SourceStatus& status_;
  HostClock clock_;
  PeriodMeter period_;
  std::array<std::uint64_t, kLossCauses> posted_{};
};

}  // namespace bolo::pipeline

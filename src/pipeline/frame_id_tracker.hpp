// Unwraps the camera's frame counter and counts each lost frame once, by cause.
#pragma once

#include <array>
#include <cstdint>

#include "src/core/loss.hpp"
#include "src/pipeline/host_clock.hpp"
#include "src/pipeline/inlet.hpp"
#include "src/pipeline/source.hpp"

namespace bolo::pipeline {

// Frames may arrive in any order within a window of kReorderFrames: a frame that is absent when a later one arrives
// counts as missing only when it leaves that window, because it may still come late or broken. After finish() every
// frame from the first to the last seen was delivered or counted as lost.
//
// GigE Vision counts frames (block_id) in 16 bits and skips 0, a period of 65535, or, with extended ids, in 64 bits. A
// camera that does send 0 has a period of 65536. Thread: acquire, or setup while no stream runs. No allocation.
class FrameIdTracker {
 public:
  static constexpr unsigned kReorderFrames = 16;

  // period_s: the camera's frame period, to distinguish a long outage from a counter reset.
  explicit FrameIdTracker(double period_s) noexcept;

  struct Verdict {
    std::uint64_t frame_id = 0;  // unwrapped
    bool deliver = false;        // false: a duplicate or too late; already counted
    bool counter_reset = false;  // since the last delivered frame
  };

  // A complete frame arrived. arrival_ns: CLOCK_MONOTONIC.
  Verdict complete(std::uint64_t raw_id, std::int64_t arrival_ns) noexcept;

  // An unusable frame arrived.
  void broken(std::uint64_t raw_id, LossCause cause, std::int64_t arrival_ns) noexcept;

  // As broken(kIncomplete), for a frame whose first packet, and with it the counter, was lost. It takes the place of
  // one of the frames that the next known counter shows to be missing, and is counted then. If none is missing, it was
  // no frame of the camera: the transport library takes any bytes on the stream's port for part of one.
  void broken_without_id() noexcept;

  // The stream was reopened, perhaps with a reset counter: the next frame's id follows the last one.
  void restart() noexcept { reset_next_ = true; }

  // The stream has ended: frames that are still absent are missing.
  void finish() noexcept;

  // Frames lost by cause. kOutOfOrder holds late frames and duplicates.
  std::uint64_t counted(LossCause cause) const noexcept { return counted_[static_cast<std::size_t>(cause)]; }

 private:
  enum class Place { kNew, kLate, kDuplicate };

  Place place(std::uint64_t raw_id, std::int64_t arrival_ns) noexcept;
  void start(std::uint64_t raw_id, std::int64_t arrival_ns) noexcept;
  void reset_counter() noexcept;
  void advance(std::uint64_t frames) noexcept;
  void close_window() noexcept;
  void place_broken(std::uint64_t frames) noexcept;
  std::int64_t steps_from_highest(std::uint64_t raw_id) const noexcept;
  bool is_reset(std::int64_t steps, std::int64_t arrival_ns) const noexcept;
  void count(LossCause cause, std::uint64_t frames = 1) noexcept {
    counted_[static_cast<std::size_t>(cause)] += frames;
  }

  double period_ns_;
  bool started_ = false;
  bool zero_seen_ = false;
  bool reset_next_ = false;     // before the next frame
  bool counter_reset_ = false;  // since the last delivered frame
  std::uint64_t highest_ = 0;
  std::uint64_t highest_raw_ = 0;
  std::int64_t highest_ns_ = 0;
  std::uint32_t known_ = ~0U;   // bit k: frame highest_ - k is delivered or counted
  std::uint64_t unplaced_ = 0;  // broken frames without id since the highest one
  std::array<std::uint64_t, kLossCauses> counted_{};
};

// Outlives a source's connections. Thread: acquire, or setup while no connection delivers. No allocation.
class Arrivals {
 public:
  // Both references must outlive this object.
  Arrivals(FrameInlet& inlet, SourceStatus& status) noexcept;

  // Tracker of frame numbers; its losses reach the inlet by post_losses().
  FrameIdTracker ids;

  // Frames of another connection follow: neither counter nor clock continues the last one's.
  void restart() noexcept;

  // Time of a frame on CLOCK_MONOTONIC, by the camera's clock. Publishes the state of both clocks, and starts a new
  // window if the camera's counter or clock has jumped. receive_ns: CLOCK_MONOTONIC.
  std::int64_t map_time(const FrameIdTracker::Verdict& verdict, std::int64_t camera_ns,
                        std::int64_t receive_ns) noexcept;

  // Copies losses to the inlet's counters, which, unlike the tracker's, may be read while the stream runs.
  void post_losses() noexcept;
  // The stream has ended: frames that are still absent are lost.
  void finish() noexcept;

 private:
  FrameInlet& inlet_;
  SourceStatus& status_;
  HostClock clock_;
  PeriodMeter period_;
  std::array<std::uint64_t, kLossCauses> posted_{};
};

}  // namespace bolo::pipeline

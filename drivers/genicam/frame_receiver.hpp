// Checks each frame of the camera, copies it into a pool slot and commits it; or counts it as lost.
#pragma once

#include <atomic>
#include <cstdint>
#include <vector>

#include "drivers/genicam/camera_frame.hpp"
#include "drivers/genicam/genicam_source.hpp"
#include "drivers/genicam/scene_watch.hpp"
#include "src/core/plane.hpp"
#include "src/pipeline/arrivals.hpp"
#include "src/rt/counters.hpp"

namespace bolo::genicam {

// Outlives the connections of one start() to stop(): after a reconnect ids and losses go on.
class FrameReceiver {
 public:
  // The inlet outlives this. Thread: setup.
  FrameReceiver(pipeline::FrameInlet& inlet, const CameraOptions& options, pipeline::SourceStatus& status);

  // Takes what it needs; its pixels may be reused afterwards. Thread: acquire.
  void take(const CameraFrame& frame) noexcept;

  // A connection's frames follow, the first or another one. kelvin_table: Negotiated's, which outlives the connection.
  // Thread: setup, while no connection delivers.
  void begin(const std::vector<std::uint16_t>& kelvin_table) noexcept;
  // Frames that arrive before `until_ns`, CLOCK_MONOTONIC, are flagged as those of a NUC. Thread: any.
  void set_nuc_until(std::int64_t until_ns) noexcept { nuc_until_ns_.set(until_ns); }
  const SceneWatch& scene() const noexcept { return scene_; }
  // Takes the threshold of a scene that stands still. Thread: any.
  void set_nuc(const NucOptions& nuc) noexcept { scene_.set_still_k(watched_still_k(nuc)); }
  // The last frame has come: counts what is still missing. Thread: setup, while no connection delivers.
  void finish() noexcept { arrivals_.finish(); }

  // CLOCK_MONOTONIC of the last complete frame, 0 before the first. Thread: any.
  std::int64_t last_frame_ns() const noexcept {
    return last_frame_ns_.load(std::memory_order_acquire);  // partner: note_arrival()
  }
  // CLOCK_MONOTONIC of the first frame of the present connection, or of the first after frames had stopped; as known
  // when last_frame_ns() was read. Thread: any.
  std::int64_t flows_since_ns() const noexcept { return flows_since_ns_.load(std::memory_order_relaxed); }

 private:
  static double watched_still_k(const NucOptions& nuc) noexcept {
    return nuc.policy == NucPolicy::kStill ? nuc.still_k : 0.0;
  }
  void deliver(const CameraFrame& frame, std::int64_t now_ns) noexcept;
  void note_arrival(std::int64_t now_ns) noexcept;
  std::uint32_t note_nuc(std::int64_t now_ns) noexcept;
  bool agreed(const CameraFrame& frame) const noexcept;

  pipeline::FrameInlet& inlet_;
  const StreamFormat format_;
  const PixelOrder order_;
  const int metadata_rows_;
  pipeline::Arrivals arrivals_;
  SceneWatch scene_;
  const std::uint16_t* kelvin_table_ = nullptr;  // null: counts stay as they are
  rt::Gauge<std::int64_t> nuc_until_ns_;
  bool in_nuc_ = false;
  bool first_of_connection_ = true;
  std::atomic<std::int64_t> flows_since_ns_{0};  // published by last_frame_ns_
  std::atomic<std::int64_t> last_frame_ns_{0};
};

}  // namespace bolo::genicam

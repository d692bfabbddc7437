// Checks each frame of the camera, then copies it to a pool slot and commits it, or counts it as lost.
#pragma once

#include <array>
#include <atomic>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "drivers/genicam/camera_frame.hpp"
#include "drivers/genicam/genicam_source.hpp"
#include "src/core/frame.hpp"
#include "src/pipeline/frame_id_tracker.hpp"
#include "src/rt/counters.hpp"

namespace bolo::genicam {

// --- Motion and plausibility from a sample of pixels; scheduling of NUCs.

// Samples about 1,000 pixels spread over the frame. No allocation.
class SceneWatch {
 public:
  // still_k: the scene stands still while the mean absolute change of its pixels over 0.1 s does not exceed this; K, or
  // counts if frames are not in kelvin. 0: motion is not measured. Thread: setup.
  SceneWatch(const StreamFormat& format, double still_k) noexcept;
  // Changes still_k. Thread: any.
  void set_still_k(double still_k) noexcept { still_counts_.set(still_k / kelvin_per_count_); }

  // A frame in host byte order, row-major. now_ns: CLOCK_MONOTONIC. Thread: acquire.
  void update(const std::uint16_t* plane, std::int64_t now_ns) noexcept;
  // Resets for the frames of a new connection. Thread: setup, while no connection delivers.
  void restart() noexcept;

  // CLOCK_MONOTONIC since when the scene stands still; 0 while it moves. Thread: any.
  std::int64_t still_since_ns() const noexcept { return still_since_ns_.value(); }
  // Median of an early frame of this connection, counts; -1 before that. Thread: any.
  int median() const noexcept { return median_.value(); }

 private:
  static constexpr std::size_t kMostSamples = 1024;
  using Samples = std::array<std::uint16_t, kMostSamples>;

  void take(const std::uint16_t* plane, Samples& samples) const noexcept;
  double change(const Samples& now) const noexcept;

  const std::size_t count_;
  const std::size_t step_;
  const double kelvin_per_count_;  // 1 if frames are not in kelvin
  rt::Gauge<double> still_counts_;
  std::uint64_t frames_ = 0;  // of this connection
  std::int64_t compared_ns_ = 0;
  Samples before_{};
  rt::Gauge<std::int64_t> still_since_ns_;
  rt::Gauge<int> median_{-1};
};

// Explains an implausible median (outside 200 to 700 K) and names the setting to change; nothing when it is plausible
// or not in kelvin. Thread: any.
std::optional<std::string> implausible(int median, const LinearScale& scale);

// Decides when a NUC is due. Times are CLOCK_MONOTONIC. Thread: one at a time.
class NucSchedule {
 public:
  explicit NucSchedule(const NucOptions& options) : options_(options) {}

  // still_since_ns: from SceneWatch. The first is due at once or, depending on the policy, when the scene stands still.
  bool due(std::int64_t now_ns, std::int64_t still_since_ns) const {
    const bool asks = options_.policy == NucPolicy::kTimed || options_.policy == NucPolicy::kStill;
    if (!asks || (last_ns_ != 0 && now_ns - last_ns_ < ns(options_.interval_s))) return false;
    if (options_.policy == NucPolicy::kTimed) return true;
    return still_since_ns != 0 && now_ns - still_since_ns >= ns(options_.still_s);
  }
  // Changes the policy; keeps the time of the last NUC.
  void set_options(const NucOptions& options) { options_ = options; }
  // A NUC was done or failed: the next follows after an interval.
  void done(std::int64_t now_ns) { last_ns_ = now_ns; }

 private:
  static std::int64_t ns(double seconds) { return static_cast<std::int64_t>(seconds * 1e9); }

  NucOptions options_;
  std::int64_t last_ns_ = 0;
};

// Lives from start() to stop(), across reconnects: ids and losses continue.
class FrameReceiver {
 public:
  // The inlet outlives this. Thread: setup.
  FrameReceiver(pipeline::FrameInlet& inlet, const CameraOptions& options, pipeline::SourceStatus& status);

  // Copies what it needs; the pixels may be reused after the call. Thread: acquire.
  void take(const CameraFrame& frame) noexcept;

  // Starts the frames of a connection. kelvin_table: from Negotiated, must outlive the connection. Thread: setup, while
  // no connection delivers.
  void begin(const std::vector<std::uint16_t>& kelvin_table) noexcept;
  // Frames that arrive before `until_ns` (CLOCK_MONOTONIC) are flagged as NUC frames. Thread: any.
  void set_nuc_until(std::int64_t until_ns) noexcept { nuc_until_ns_.set(until_ns); }
  const SceneWatch& scene() const noexcept { return scene_; }
  // Updates the threshold for a still scene. Thread: any.
  void set_nuc(const NucOptions& nuc) noexcept { scene_.set_still_k(watched_still_k(nuc)); }
  // Counts the frames still missing after the last one. Thread: setup, while no connection delivers.
  void finish() noexcept { arrivals_.finish(); }

  // CLOCK_MONOTONIC of the last complete frame, 0 before the first. Thread: any.
  std::int64_t last_frame_ns() const noexcept {
    return last_frame_ns_.load(std::memory_order_acquire);  // partner: note_arrival()
  }
  // CLOCK_MONOTONIC of the first frame of the connection or after an interruption; consistent with the preceding
  // last_frame_ns(). Thread: any.
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
  const std::uint16_t* kelvin_table_ = nullptr;  // null: counts are unchanged
  rt::Gauge<std::int64_t> nuc_until_ns_;
  bool in_nuc_ = false;
  bool first_of_connection_ = true;
  std::atomic<std::int64_t> flows_since_ns_{0};  // published by last_frame_ns_
  std::atomic<std::int64_t> last_frame_ns_{0};
};

}  // namespace bolo::genicam

// Checks each frame of the camera, copies it into a pool slot and commits it; or counts it as lost.
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

// --- Detects from a sample of pixels since when the scene stands still, and if the values can be temperatures; decides
// when a NUC is due.

// Samples some 1,000 pixels spread over the frame. Nothing is allocated.
class SceneWatch {
 public:
  // still_k: a scene stands still while, from one tenth of a second to the next, its pixels change by no more than this
  // on average; K, or counts where frames have no kelvin. 0: motion is not measured. Thread: setup.
  SceneWatch(const StreamFormat& format, double still_k) noexcept;
  // Another still_k from now on. Thread: any.
  void set_still_k(double still_k) noexcept { still_counts_.set(still_k / kelvin_per_count_); }

  // A frame in the host's byte order, row-major. now_ns: CLOCK_MONOTONIC. Thread: acquire.
  void update(const std::uint16_t* plane, std::int64_t now_ns) noexcept;
  // Frames of another connection follow. Thread: setup, while no connection delivers.
  void restart() noexcept;

  // CLOCK_MONOTONIC since when nothing has moved; 0 while something does. Thread: any.
  std::int64_t still_since_ns() const noexcept { return still_since_ns_.value(); }
  // The median of one early frame of this connection, counts; -1 before it came. Thread: any.
  int median() const noexcept { return median_.value(); }

 private:
  static constexpr std::size_t kMostSamples = 1024;
  using Samples = std::array<std::uint16_t, kMostSamples>;

  void take(const std::uint16_t* plane, Samples& samples) const noexcept;
  double change(const Samples& now) const noexcept;

  const std::size_t count_;
  const std::size_t step_;
  const double kelvin_per_count_;  // 1 where frames have no kelvin
  rt::Gauge<double> still_counts_;
  std::uint64_t frames_ = 0;  // of this connection
  std::int64_t compared_ns_ = 0;
  Samples before_{};
  rt::Gauge<std::int64_t> still_since_ns_;
  rt::Gauge<int> median_{-1};
};

// Why the median of a frame cannot be right by its scale, and the setting to change; nothing when it can, or has no
// kelvin. Plausible are 200 to 700 K. Thread: any.
std::optional<std::string> implausible(int median, const LinearScale& scale);

// Decides when a NUC is due.
// Times are CLOCK_MONOTONIC. Thread: one at a time.
class NucSchedule {
 public:
  explicit NucSchedule(const NucOptions& options) : options_(options) {}

  // still_since_ns: SceneWatch's. The first is due at once, or, by policy, as soon as the scene stands still.
  bool due(std::int64_t now_ns, std::int64_t still_since_ns) const {
    const bool asks = options_.policy == NucPolicy::kTimed || options_.policy == NucPolicy::kStill;
    if (!asks || (last_ns_ != 0 && now_ns - last_ns_ < ns(options_.interval_s))) return false;
    if (options_.policy == NucPolicy::kTimed) return true;
    return still_since_ns != 0 && now_ns - still_since_ns >= ns(options_.still_s);
  }
  // Another policy; the time of the last NUC stays.
  void set_options(const NucOptions& options) { options_ = options; }
  // One was done, or could not be: the next is an interval away.
  void done(std::int64_t now_ns) { last_ns_ = now_ns; }

 private:
  static std::int64_t ns(double seconds) { return static_cast<std::int64_t>(seconds * 1e9); }

  NucOptions options_;
  std::int64_t last_ns_ = 0;
};

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

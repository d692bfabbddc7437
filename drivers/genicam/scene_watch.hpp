// Tells from a sample of pixels since when the scene stands still, and if the values can be temperatures; when a NUC is
// due.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>

#include "drivers/genicam/genicam_source.hpp"
#include "src/core/plane.hpp"
#include "src/rt/counters.hpp"

namespace bolo::genicam {

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

// Why the median of a frame cannot be what its scale says, and the setting to change; nothing when it can, or has no
// kelvin. Believed are 200 to 700 K. Thread: any.
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

}  // namespace bolo::genicam

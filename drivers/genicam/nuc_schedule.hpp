// Decides when a NUC is due.
#pragma once

#include <cstdint>

#include "drivers/genicam/genicam_source.hpp"

namespace bolo::genicam {

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

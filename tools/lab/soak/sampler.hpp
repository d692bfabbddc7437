// Looks at the processes once a second, and keeps what it saw.
#pragma once

#include <map>
#include <vector>

#include "tools/lab/soak/result.hpp"
#include "tools/lab/soak/rig.hpp"
#include "tools/lab/soak/watcher.hpp"

namespace bolo::tools::soak {

// Thread: one at a time.
class Sampler {
 public:
  // All outlive this.
  Sampler(Rig& rig, Watcher& watcher, Findings& findings) : rig_(rig), watcher_(watcher), findings_(findings) {}

  void sample(double now_s, bool quiet);

  const std::vector<Second>& timeline() const noexcept { return timeline_; }
  const std::vector<double>& quiet_ms() const noexcept { return quiet_ms_; }  // latencies of quiet times
  // Hands over the timeline, the minutes and the counts.
  void finish(SoakResult& result);

 private:
  void take_flow(Second& second);
  void take_usage(Second& second);

  Rig& rig_;
  Watcher& watcher_;
  Findings& findings_;
  std::vector<Second> timeline_;
  std::vector<LatencyFigures> minutes_;
  std::vector<double> minute_ms_;
  std::vector<double> quiet_ms_;
  Flow sum_;             // without latencies
  Counters counted_;     // at the last sample
  double busy_s_ = 0.0;  // all processors, at the last sample
  double ours_s_ = 0.0;
  std::map<pid_t, double> cpu_of_;
};

}  // namespace bolo::tools::soak

// What each kind of trouble does to the processes.
#pragma once

#include "tools/lab/soak/jobs.hpp"
#include "tools/lab/soak/rig.hpp"

namespace bolo::tools::soak {

// Thread: one at a time. What the camera does by its script needs no act.
class Acts {
 public:
  Acts(Rig& rig, Findings& findings) : rig_(rig), findings_(findings) {}

  void begin(const Disturbance& disturbance);
  void end(const Disturbance& disturbance);
  // Waits for what still runs.
  void finish() { jobs_.finish(); }

 private:
  void record(const Disturbance& disturbance, RecordingEnd end);
  void take_processors(double seconds);
  void take_memory(double seconds);
  void start_helper(const Command& command);
  void end_helper(bool must_be_well);
  void write_config(bool right);
  void step_clock(double by_s);

  Rig& rig_;
  Findings& findings_;
  Jobs jobs_;
  std::optional<Process> helper_;  // a slow reader, stress-ng
  int count_ = 0;
};

}  // namespace bolo::tools::soak

// What takes its time and is judged at its end, beside the soak's own thread: recordings, commands, work for processors
// and memory.
#pragma once

#include <filesystem>
#include <functional>
#include <future>
#include <string>
#include <vector>

#include "tools/lab/soak/findings.hpp"
#include "tools/lab/soak/rig.hpp"

namespace bolo::tools::soak {

// Waits for all of them in the end. Thread: one at a time.
class Jobs {
 public:
  void add(std::function<void()> job) { running_.push_back(std::async(std::launch::async, std::move(job))); }
  ~Jobs() { finish(); }
  Jobs() = default;
  Jobs(const Jobs&) = delete;
  Jobs& operator=(const Jobs&) = delete;
  void finish() {
    for (std::future<void>& job : running_) job.wait();
    running_.clear();
  }

 private:
  std::vector<std::future<void>> running_;
};

// What each kind of trouble does to the processes.

// Thread: one at a time. What the camera does by its script needs no act.
class Acts {
 public:
  Acts(Rig& rig, Findings& findings) : rig_(rig), findings_(findings) {}

  void begin(const Disturbance& disturbance);
  void end(const Disturbance& disturbance);
  // Waits for what still runs.
  void finish() { jobs_.finish(); }

 private:
  void record(const Disturbance& disturbance);
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

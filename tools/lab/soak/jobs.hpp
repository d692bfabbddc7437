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

enum class RecordingEnd { kInterrupted, kKilled, kDiskFull };

struct RecordingJob {
  Programs programs;
  std::string daemon;  // its name
  std::filesystem::path file;
  const Truth* truth = nullptr;
  RecordingEnd end = RecordingEnd::kInterrupted;
  double seconds = 1.0;
  std::uint64_t most_bytes = 0;  // kDiskFull
};

// Records, ends it so, saves what a killed one left, and looks at every plane. Blocks. Thread: any.
void record_and_judge(const RecordingJob& job, Findings& findings);

// bolo nuc. Blocks. Thread: any.
void correct_and_judge(const Programs& programs, const std::string& daemon, const std::filesystem::path& log,
                       Findings& findings);

// One thread a processor counts up; some memory is filled over and over. Block. Thread: any.
void take_processors(double seconds);
void take_memory(double seconds, std::uint64_t bytes);

}  // namespace bolo::tools::soak

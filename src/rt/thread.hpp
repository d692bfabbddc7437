// Names, priorities and places of threads.
#pragma once

#include <string>
#include <vector>

#include "src/core/result.hpp"

namespace bolo::rt {

struct ThreadOptions {
  std::string name;           // at most 15 characters are shown by ps and perf
  int realtime_priority = 0;  // 1..99: SCHED_FIFO; 0: the default scheduler
  std::vector<int> cpus{};    // empty: any
};

// Applies the options to the calling thread. A priority or affinity that the system refuses is an error whose message
// names the limit to raise; the thread goes on without it. Thread: the thread concerned.
Status apply_to_this_thread(const ThreadOptions& options);

}  // namespace bolo::rt

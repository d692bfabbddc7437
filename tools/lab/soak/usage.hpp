// What a process uses, from /proc.
#pragma once

#include <sys/types.h>

#include <cstdint>
#include <optional>

namespace bolo::tools::soak {

struct Usage {
  double rss_mib = 0.0;
  double pss_mib = 0.0;      // its share of what several processes map: falls when another reader comes
  double private_mib = 0.0;  // of the PSS, what is nobody else's (anonymous)
  int descriptors = 0;
  int threads = 0;
  double cpu_s = 0.0;  // since its start
};

// Nothing of a process that is gone. Thread: any.
std::optional<Usage> usage_of(pid_t pid);

// What all processors have worked since the computer's start, but for niced programs, which give way; s. Thread: any.
double busy_s();

}  // namespace bolo::tools::soak

// What a process uses, from /proc.
#pragma once

#include <sys/types.h>

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

namespace bolo::tools::soak {

struct Usage {
  double rss_mib = 0.0;
  double private_mib = 0.0;  // of what several processes may map (PSS), what is nobody else's (anonymous)
  int descriptors = 0;
  int threads = 0;
  double cpu_s = 0.0;  // since its start
};

// Nothing of a process that is gone. Thread: any.
std::optional<Usage> usage_of(pid_t pid);

// What all processors have worked since the computer's start, but for niced programs, which give way; s. Thread: any.
double busy_s();

// --- Whether something grows: memory, open files, threads.

struct Reading {
  double at_s = 0.0;
  double value = 0.0;
};

struct Growth {
  double first = 0.0;           // median of the first fifth
  double last = 0.0;            // median of the last fifth
  double slope_per_hour = 0.0;  // median of the slopes of all pairs (Theil and Sen): one odd reading does not move it
  bool judged = false;          // there were enough readings

  double by() const { return last - first; }
};

// Of the readings from `settle_s` after the first one on; judged when they span as much again and are ten.
// Thread: any.
Growth growth_of(const std::vector<Reading>& readings, double settle_s);

// Whether it grew by `limit` or more, by both measures: the medians, and the slope over the time that they span.
// Thread: any.
bool grows(const Growth& growth, double span_s, double limit);

}  // namespace bolo::tools::soak

// Checks that frames flow: the condition for feeding the service manager's watchdog.
#pragma once

#include <cstdint>
#include <string>

namespace bolo::daemon {

// State of pipeline and source at one moment. Times: CLOCK_MONOTONIC.
struct Signs {
  std::int64_t now_ns = 0;
  std::int64_t polled_ns = 0;   // when the pipeline thread last polled for a frame; 0: it does not run yet
  std::uint64_t received = 0;   // frames that reached the queue
  std::uint64_t handled = 0;    // frames published, or dropped as repeats of the one before
  bool watched = false;         // the source monitors a camera and reports its state:
  bool streams = false;         // it reports that the camera streams
  std::int64_t watched_ns = 0;  // when it last checked
};

// All is well while frames that come are published, or while none comes and the source reports the cause: its camera
// stalls, is lost or does a NUC, and is being monitored. A source that is not monitored has no frame due when none
// comes. Thread: one at a time.
class FlowWatch {
 public:
  // stall_ns: after such a silence a monitored source reports that its camera stalls. lookahead: frames that come
  // before the first is published.
  FlowWatch(double frame_period_s, int lookahead, std::int64_t stall_ns, std::int64_t start_ns);

  // Empty when all is well, else the fault in words. At several calls a second.
  std::string check(const Signs& signs);

 private:
  // A number that should rise, and when it last did.
  struct Progress {
    std::uint64_t value = 0;
    std::int64_t since_ns = 0;
    void update(std::uint64_t now_value, std::int64_t now_ns) {
      if (now_value == value) return;
      value = now_value;
      since_ns = now_ns;
    }
  };
  const std::int64_t patience_ns_;  // from a frame's arrival to its being published
  const std::int64_t stall_ns_;
  Progress received_;
  Progress handled_;
};

}  // namespace bolo::daemon

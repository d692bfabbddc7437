// Whether frames really flow: what the service manager's watchdog is fed by.
#pragma once

#include <cstdint>
#include <string>

namespace bolo::daemon {

// What is seen of pipeline and source at one moment. Times: CLOCK_MONOTONIC.
struct Signs {
  std::int64_t now_ns = 0;
  std::int64_t looked_ns = 0;   // when the pipeline thread last came to look for a frame; 0: it does not run yet
  std::uint64_t received = 0;   // frames that reached the queue
  std::uint64_t handled = 0;    // frames published, or dropped as repeats of the one before
  bool watched = false;         // the source looks after a camera and says how it is:
  bool streams = false;         // it says that the camera streams
  std::int64_t watched_ns = 0;  // when it last looked
};

// All is well while frames that come are published, or while none comes and the source says why: its camera stalls, is
// lost or corrects itself, and is being looked after. A source that is not watched has no frame due when none comes.
// Thread: one at a time.
class FlowWatch {
 public:
  // stall_ns: after such a silence a watched source says that its camera stalls. lookahead: frames that come before
  // the first is published.
  FlowWatch(double frame_period_s, int lookahead, std::int64_t stall_ns, std::int64_t start_ns);

  // Empty when all is well, else what does not go on, for people. At several calls a second.
  std::string look(const Signs& signs);

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

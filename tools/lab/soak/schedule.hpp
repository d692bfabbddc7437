// When a soak makes which trouble. Everything follows from the seed.
#pragma once

#include <cstdint>
#include <set>
#include <string>
#include <vector>

#include "tools/lab/soak/kinds.hpp"

namespace bolo::tools::soak {

struct Disturbance {
  Kind kind = Kind::kLoss;
  double at_s = 0.0;   // from the round's beginning: the first frame of its camera
  double for_s = 0.0;  // 0: over at once
  std::uint64_t seed = 0;
  std::string faults;  // of the camera's: as bolo fakecam --fault reads them, with spaces between
};

// One camera process, and what happens in its time. A round begins with a camera of its own.
struct Round {
  std::vector<Disturbance> disturbances;  // in time

  // The faults of all, for its camera.
  std::vector<std::string> faults() const;
};

struct Schedule {
  std::uint64_t seed = 0;
  double round_s = 0.0;
  std::vector<Round> rounds;
  std::vector<Kind> no_room;  // kinds that were asked for and found no place
};

struct ScheduleRequest {
  std::uint64_t seed = 1;
  double seconds = 120.0;
  std::set<Kind> kinds;  // that may be drawn
};

// Each kind once a round, in an order of its own each time, with a quiet time after each; daemon_killed in every third
// round only, so that daemons live long enough to grow. A run too short for all has those that find room.
// Thread: any.
Schedule draw_schedule(const ScheduleRequest& request);

}  // namespace bolo::tools::soak

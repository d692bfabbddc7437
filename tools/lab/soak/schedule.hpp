// Kinds of disturbances in a soak, and their schedule.
#pragma once

#include <cstdint>
#include <optional>
#include <set>
#include <span>
#include <string>
#include <string_view>
#include <vector>

namespace bolo::tools::soak {

enum class Kind {
  // The fake camera's own faults, by their names there (bolo fakecam --list-faults); but those of a camera that is set
  // up wrong, byte_order and metadata_rows, which come and go with no camera.
  kLoss,
  kReorder,
  kDuplicate,
  kGarbage,
  kNoResend,
  kIdGap,
  kTimeJump,
  kStall,
  kFreeze,
  kControlLoss,
  kReboot,
  kShutter,
  kWindowingDrop,
  // Processes.
  kCameraStopped,
  kCameraReplaced,
  kDaemonStopped,
  kDaemonKilled,
  kReaderKilled,
  kReaderStopped,
  kRecording,
  kRecorderKilled,
  kDiskFull,
  // The computer.
  kCpuTaken,
  kMemoryTaken,
  // The daemon's commands.
  kReload,
  kBadReload,
  kCorrection,
};

struct KindInfo {
  Kind kind = Kind::kLoss;
  std::string_view name;
  double shortest_s = 0.0;  // how long it lasts
  double longest_s = 0.0;
  double recovers_within_s = 0.0;  // after its end: until frames flow that are right, without a gap
  double room_s = 0.0;             // from its start to the next one's at least: lasting, recovery, a quiet time
  std::string_view script{};       // a fault of the fake camera's, as parse_fault() reads what follows its name
};

// All of them, in the order of Kind. Thread: any.
std::span<const KindInfo> kinds();
const KindInfo& info_of(Kind kind);
std::optional<Kind> kind_named(std::string_view name);

// --- The schedule of disturbances. Everything follows from the seed.

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

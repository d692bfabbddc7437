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
  // The fake camera's faults, by their names there (bolo fakecam --list-faults), except those of a misconfigured
  // camera, byte_order and metadata_rows, which last as long as the camera.
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
  // Faults of processes.
  kCameraStopped,
  kCameraReplaced,
  kDaemonStopped,
  kDaemonKilled,
  kReaderKilled,
  kReaderStopped,
  kRecording,
  kRecorderKilled,
  kDiskFull,
  // Load on the computer.
  kCpuTaken,
  kMemoryTaken,
  // Commands to the daemon.
  kReload,
  kBadReload,
  kCorrection,
};

struct KindInfo {
  Kind kind = Kind::kLoss;
  std::string_view name;
  double shortest_s = 0.0;  // duration
  double longest_s = 0.0;
  double recovers_within_s = 0.0;  // from its end to correct frames without a gap
  double room_s = 0.0;             // least time to the next start: duration, recovery, quiet time
  std::string_view script{};       // fault of the fake camera: text after its name, for parse_fault()
};

// All kinds, in the order of Kind. Thread: any.
std::span<const KindInfo> kinds();
const KindInfo& info_of(Kind kind);
std::optional<Kind> kind_named(std::string_view name);

// --- The schedule of disturbances, determined by the seed.

struct Disturbance {
  Kind kind = Kind::kLoss;
  double at_s = 0.0;   // since the round's start: the first frame of its camera
  double for_s = 0.0;  // 0: momentary
  std::uint64_t seed = 0;
  std::string faults;  // for the camera: as for bolo fakecam --fault, separated by blanks
};

// One camera process and the disturbances in its time. Each round starts a new camera.
struct Round {
  std::vector<Disturbance> disturbances;  // in order of time

  // The faults of all disturbances, for the camera.
  std::vector<std::string> faults() const;
};

struct Schedule {
  std::uint64_t seed = 0;
  double round_s = 0.0;
  std::vector<Round> rounds;
  std::vector<Kind> no_room;  // requested kinds without a place
};

struct ScheduleRequest {
  std::uint64_t seed = 1;
  double seconds = 120.0;
  std::set<Kind> kinds;  // kinds that may be drawn
};

// Each kind once per round, in a new order each time and followed by a quiet time; daemon_killed only in every third
// round, so that daemons live long enough to show growth. A run too short for all contains those that fit. Thread: any.
Schedule draw_schedule(const ScheduleRequest& request);

}  // namespace bolo::tools::soak

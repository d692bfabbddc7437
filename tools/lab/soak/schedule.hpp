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
  // The fake camera's own faults, under their names there (bolo fakecam --list-faults), except those of a misconfigured
  // camera, byte_order and metadata_rows, which are permanent.
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
  // Process faults.
  kCameraStopped,
  kCameraReplaced,
  kDaemonStopped,
  kDaemonKilled,
  kReaderKilled,
  kReaderStopped,
  kRecording,
  kRecorderKilled,
  kDiskFull,
  // Loads on the computer.
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
  double shortest_s = 0.0;  // shortest duration
  double longest_s = 0.0;
  double recovers_within_s = 0.0;  // limit from its end until right frames flow without a gap
  double room_s = 0.0;             // least time from its start to the next one's: duration, recovery, a quiet time
  std::string_view script{};       // a fake camera's fault, in the syntax of parse_fault() after its name
};

// All kinds, in the order of Kind. Thread: any.
std::span<const KindInfo> kinds();
const KindInfo& info_of(Kind kind);
std::optional<Kind> kind_named(std::string_view name);

// --- The schedule of disturbances, determined by the seed.

struct Disturbance {
  Kind kind = Kind::kLoss;
  double at_s = 0.0;   // from the start of the round: its camera's first frame
  double for_s = 0.0;  // 0: momentary
  std::uint64_t seed = 0;
  std::string faults;  // of the camera: in the syntax of bolo fakecam --fault, separated by spaces
};

// One camera process and the disturbances in its time. Each round starts a new camera.
struct Round {
  std::vector<Disturbance> disturbances;  // in order of time

  std::vector<std::string> faults() const;
};

struct Schedule {
  std::uint64_t seed = 0;
  double round_s = 0.0;
  std::vector<Round> rounds;
  std::vector<Kind> no_room;  // requested kinds that did not fit
};

struct ScheduleRequest {
  std::uint64_t seed = 1;
  double seconds = 120.0;
  std::set<Kind> kinds;  // kinds to draw from
};

// Each kind once a round, in a new order each time, with a quiet time after each; daemon_killed only in every third
// round, so that daemons live long enough to show growth. If the run is too short, only the kinds that fit. Thread:
// any.
Schedule draw_schedule(const ScheduleRequest& request);

}  // namespace bolo::tools::soak

// The kinds of trouble that a soak makes.
#pragma once

#include <optional>
#include <span>
#include <string_view>

namespace bolo::tools::soak {

enum class Kind {
  // The fake camera's own faults, by their names there (bolo fakecam --list-faults).
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
  kByteOrder,
  kMetadataRows,
  kWindowingDrop,
  // Processes.
  kCameraStopped,
  kCameraReplaced,
  kDaemonStopped,
  kDaemonKilled,
  kReaderKilled,
  kReaderStopped,
  kReaderSlow,
  kRecording,
  kRecorderKilled,
  kDiskFull,
  // The computer.
  kClockStep,
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
  std::string_view about;
  double shortest_s = 0.0;  // how long it lasts
  double longest_s = 0.0;
  double recovers_within_s = 0.0;  // after its end: until frames flow that are right, without a gap
  double room_s = 0.0;             // from its start to the next one's at least: lasting, recovery, a quiet time
  bool of_camera = false;          // a fault of the fake camera's script
};

// All of them, in the order of Kind. Thread: any.
std::span<const KindInfo> kinds();
const KindInfo& info_of(Kind kind);
std::optional<Kind> kind_named(std::string_view name);

}  // namespace bolo::tools::soak

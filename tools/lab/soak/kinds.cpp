#include "tools/lab/soak/kinds.hpp"

#include <algorithm>
#include <array>
#include <cstddef>

namespace bolo::tools::soak {
namespace {

// Times to recover are limits, for a machine that others use as well. What takes long: a camera that is silent is asked
// after 0.2 s and opened again, with its start-up; a killed daemon is started again after 0.3 s, and
// promised to be back 2 s after the kill (PROMISES.md).
constexpr std::array<KindInfo, 31> kKinds{{
    {Kind::kLoss, "loss", "packets are lost and asked for again", 0.3, 0.8, 3.0, 2.2, true},
    {Kind::kReorder, "reorder", "packets arrive late", 0.3, 0.8, 3.0, 2.2, true},
    {Kind::kDuplicate, "duplicate", "packets arrive twice", 0.3, 0.8, 3.0, 2.2, true},
    {Kind::kGarbage, "garbage", "packets of random bytes between the camera's", 0.3, 0.8, 4.0, 2.4, true},
    {Kind::kNoResend, "resend_unanswered", "packets are lost, and requests for them not answered", 0.3, 0.8, 3.0, 2.4,
     true},
    {Kind::kIdGap, "id_gap", "the camera's counter jumps", 0.0, 0.0, 3.0, 1.6, true},
    {Kind::kTimeJump, "time_jump", "the camera's clock jumps", 0.0, 0.0, 3.0, 1.6, true},
    {Kind::kStall, "stall", "the camera sends nothing, but answers", 0.2, 0.6, 6.0, 2.6, true},
    {Kind::kFreeze, "freeze", "the camera neither sends nor answers", 0.3, 1.0, 8.0, 3.6, true},
    {Kind::kControlLoss, "control_loss", "the camera takes control away", 0.0, 0.0, 10.0, 3.2, true},
    {Kind::kReboot, "reboot", "the camera starts anew and forgets all", 0.5, 1.0, 10.0, 4.2, true},
    {Kind::kShutter, "nuc", "the camera's shutter: repeated frames, then an offset", 0.3, 0.5, 3.0, 2.2, true},
    {Kind::kByteOrder, "byte_order", "pixels come with their bytes swapped", 0.2, 0.5, 3.0, 2.0, true},
    {Kind::kMetadataRows, "metadata_rows", "the last rows hold metadata", 0.2, 0.5, 3.0, 2.0, true},
    {Kind::kWindowingDrop, "windowing_drop", "the camera drops the connection that sets it up", 0.5, 1.0, 15.0, 4.5,
     true},
    {Kind::kCameraStopped, "camera_stopped", "SIGSTOP of the camera, then SIGCONT", 0.3, 1.0, 10.0, 4.0, false},
    {Kind::kCameraReplaced, "camera_replaced", "the camera ends; another process takes its place", 0.3, 0.8, 15.0, 4.5,
     false},
    {Kind::kDaemonStopped, "daemon_stopped", "SIGSTOP of bolod, then SIGCONT", 0.2, 1.2, 5.0, 3.4, false},
    {Kind::kDaemonKilled, "daemon_killed", "SIGKILL of bolod; started again, as a service is", 0.3, 0.3, 1.7, 5.0,
     false},
    {Kind::kReaderKilled, "reader_killed", "SIGKILL of a reader; another one begins", 0.2, 0.5, 2.0, 1.6, false},
    {Kind::kReaderStopped, "reader_stopped", "SIGSTOP of a reader, then SIGCONT", 0.5, 1.2, 2.0, 2.2, false},
    {Kind::kReaderSlow, "reader_slow", "a reader that takes 50 ms a frame", 0.8, 1.5, 2.0, 2.4, false},
    {Kind::kRecording, "recording", "a recording, ended in good order", 1.0, 1.5, 3.0, 3.0, false},
    {Kind::kRecorderKilled, "recorder_killed", "SIGKILL of a recording; what is left is recovered", 1.2, 1.8, 3.0, 3.2,
     false},
    {Kind::kDiskFull, "disk_full", "a recording on a disk without room", 1.5, 2.5, 3.0, 3.8, false},
    {Kind::kClockStep, "clock_step", "CLOCK_REALTIME is set by seconds, then back", 0.5, 1.0, 3.0, 2.4, false},
    {Kind::kCpuTaken, "cpu_taken", "other programs on every processor", 0.8, 1.5, 5.0, 3.2, false},
    {Kind::kMemoryTaken, "memory_taken", "another program fills memory", 0.8, 1.5, 5.0, 3.2, false},
    {Kind::kReload, "reload", "SIGHUP with a changed file", 0.0, 0.0, 2.0, 1.4, false},
    {Kind::kBadReload, "bad_reload", "SIGHUP with a file that is wrong", 0.5, 0.5, 2.0, 1.8, false},
    {Kind::kCorrection, "correction", "bolo nuc: the camera is told to correct its pixels", 0.6, 0.6, 3.0, 2.4, false},
}};

}  // namespace

std::span<const KindInfo> kinds() { return kKinds; }

const KindInfo& info_of(Kind kind) { return kKinds[static_cast<std::size_t>(kind)]; }

std::optional<Kind> kind_named(std::string_view name) {
  const auto* const found = std::ranges::find(kKinds, name, &KindInfo::name);
  return found == kKinds.end() ? std::nullopt : std::optional(found->kind);
}

}  // namespace bolo::tools::soak

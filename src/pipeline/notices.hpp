// Events of a source or sink for the log: changes of state, each once.
#pragma once

#include <cstddef>
#include <cstdint>
#include <deque>
#include <mutex>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

namespace bolo::pipeline {

// Names of events for programs that read the log (BOLO_EVENT in the journal). They must not change.
namespace event {
inline constexpr std::string_view kStart = "start";
inline constexpr std::string_view kEnd = "end";
inline constexpr std::string_view kFramesFlow = "frames_flow";        // the first ones, or again after a silence
inline constexpr std::string_view kFramesStopped = "frames_stopped";  // from a source that is not monitored
inline constexpr std::string_view kFramesLost = "frames_lost";
inline constexpr std::string_view kOverload = "overload";       // less effort per frame than configured
inline constexpr std::string_view kFullEffort = "full_effort";  // end of overload
inline constexpr std::string_view kCameraStalled = "camera_stalled";
inline constexpr std::string_view kCameraLost = "camera_lost";
inline constexpr std::string_view kCameraReconnecting = "camera_reconnecting";  // an attempt failed
inline constexpr std::string_view kCameraBack = "camera_back";
inline constexpr std::string_view kNuc = "nuc";
inline constexpr std::string_view kClockStep = "clock_step";  // the host's clock was set
inline constexpr std::string_view kGyro = "gyro";             // becomes useful or useless
inline constexpr std::string_view kGapGrew = "gap_grew";      // the profile no longer fits the camera, or fits again
inline constexpr std::string_view kSettingsDoubted = "settings_doubted";  // contradicted by the frames
inline constexpr std::string_view kVideoLost = "video_lost";
inline constexpr std::string_view kVideoBack = "video_back";
inline constexpr std::string_view kReload = "reload";
inline constexpr std::string_view kWatchdog = "watchdog";
}  // namespace event

struct Notice {
  bool warning = false;
  std::string text;
  std::string_view event{};                                     // one of those above, or empty
  std::vector<std::pair<std::string, std::uint64_t>> counts{};  // numbers in the text, by name: "lost_missing"
};

// Thread: any, except one that delivers frames: it locks and allocates.
class Notices {
 public:
  // Drops a notice that repeats the last one, and the oldest of more than kMost.
  void report(bool warning, std::string text, std::string_view event = {});
  // The next notice is kept even if it repeats the last one.
  void forget_last();
  // Notices since the last call, newest last.
  std::vector<Notice> take();

 private:
  static constexpr std::size_t kMost = 256;
  std::mutex mutex_;
  std::deque<Notice> waiting_;
  std::string last_;
};

}  // namespace bolo::pipeline

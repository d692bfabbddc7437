// Runs the daemon's pipeline with a failing camera, over real packets on loopback, to a sink, and judges the results;
// scenarios of faults with their expected results.
#pragma once

#include <array>

#include "drivers/fakecam/fake_camera.hpp"
#include "drivers/genicam/genicam_source.hpp"
#include "src/core/frame.hpp"
#include "src/core/loss.hpp"
#include "src/pipeline/pipeline.hpp"
#include "tools/lab/common.hpp"
#include "tools/lab/recording.hpp"

namespace bolo::tools::faults {

using Counts = std::vector<std::uint16_t>;
using Losses = std::array<std::uint64_t, kLossCauses>;  // frames, by cause

struct RunTask {
  const Recording* scene = nullptr;  // uint16 in kelvin at 10 mK per count; long enough for the run
  int rows_below = 0;                // blank sensor rows below the scene
  fakecam::FaultScript faults;
  genicam::CameraOptions camera;  // its address is also the fake camera's
  pipeline::PipelineOptions pipeline;
  double seconds = 1.0;  // since the start of the first stream
};

struct Published {
  FrameMeta meta;
  std::int64_t publish_ns = 0;
  Counts raw;
  Counts deblurred;
};

struct RunResult {
  std::vector<Published> frames;
  Losses lost{};
  std::uint64_t reconnects = 0;
  std::vector<fakecam::InjectedFault> injected;  // as in the task's script
  fakecam::FakeCameraStats camera;
  std::vector<double> latency_ms;  // from first packet to publication, per frame
  // UDP packets, of any program, that this host dropped for lack of socket buffers: they may explain missing frames.
  std::uint64_t host_dropped = 0;
};

// Time of the first frame in each stream of the fake camera; the others follow at the frame period.
inline constexpr std::int64_t kFirstCameraNs = 1'000'000'000;

// Options for a fake camera: the scene's size and rate, several packets per frame, no long waits. Thread: any.
genicam::CameraOptions camera_options(const Recording& scene, const std::string& address);

// A new loopback address for each call; it contains the process id, so that programs can run in parallel. Thread: any.
std::string fresh_address();

// Errors: of camera, source and pipeline; a camera that never streams. Thread: setup.
Result<RunResult> run(const RunTask& task);

// The deblurred plane of each frame without faults, by number; empty without a full window. Thread: setup.
Result<std::vector<Counts>> undisturbed(const Recording& scene, const pipeline::PipelineOptions& options);

// --- Judgement of a run.

// Effects of the faults on frames that arrive. Times: s since the first stream's start; negative: no single moment.
struct Disturbance {
  double from_s = -1.0;
  double to_s = -1.0;          // end of the last fault; from_s for momentary ones
  double clock_shift_s = 0.0;  // of the camera's clock, from then on
  int offset_counts = 0;       // of all pixels, from then on
};

struct Verdict {
  std::uint64_t right = 0;       // the deblurred plane equals the reference
  std::uint64_t warm_up = 0;     // flagged: the window is not full, so the raw plane was published
  std::uint64_t gap = 0;         // flagged: differs, because a frame of its window is lost
  std::uint64_t settling = 0;    // differs without a flag, less than a window after the disturbance
  std::uint64_t wrong = 0;       // differs without a flag or an excuse
  std::uint64_t strange = 0;     // the raw plane is not one of the scene's
  std::uint64_t never_came = 0;  // missing frames within a stream
  bool recovered = false;        // the run ends with right frames
  // From the end of the disturbance until all frames are right; 0 if all were, or without a disturbance.
  double recovery_ms = 0.0;
};

// `reference`: from undisturbed(); `window`: frames. Thread: any.
Verdict judge(const RunResult& result, const Recording& scene, const std::vector<Counts>& reference, int window,
              const Disturbance& disturbance);

// Losses expected from the camera's record of its faults. `resends`: lost packets are sent again. Thread: any.
Losses expected_losses(const fakecam::FaultScript& script, const std::vector<fakecam::InjectedFault>& injected,
                       bool resends);

// --- The fault scenarios.

// Expected results of a scenario, and its settings besides the faults.
struct Demands {
  bool resends = false;  // the daemon requests lost packets and gets them, which saves most frames
  int least_reconnects = 0;
  int most_reconnects = 0;
  // False: losses also depend on timing (resends, reopening): then missing frames need only be counted.
  bool exact = true;
  std::function<void(RunTask&)> prepare = nullptr;  // applies further settings
};

struct Scenario {
  std::string name;
  std::string faults;  // separated by blanks, as parse_fault() reads them
  double seconds = 1.0;
  Disturbance disturbance{};
  Demands demands{};
};

// All scenarios, for a small scene at 200 Hz. Thread: any.
const std::vector<Scenario>& scenarios();

// Input of all scenarios: 64x24 pixels of a street that passes by, with the result of an undisturbed run.
struct Stage {
  Recording scene;
  pipeline::PipelineOptions pipeline;
  std::vector<Counts> reference;
};
Result<Stage> make_stage();

struct Outcome {
  RunResult run;
  Verdict verdict;
  Losses expected{};

  bool losses_match() const { return run.lost == expected; }
};

// Plays a scenario on a camera of its own; retries, up to three times in all, if this host dropped packets itself.
// `seed` selects the affected packets. Thread: any.
Result<Outcome> play(const Scenario& scenario, const Stage& stage, int seed = 1);

// Describes unmet demands; empty: none. Thread: any.
std::string unmet_demands(const Scenario& scenario, const Outcome& outcome);

// "incomplete 12, missing 3", or "none". Thread: any.
std::string text_of(const Losses& losses);

}  // namespace bolo::tools::faults

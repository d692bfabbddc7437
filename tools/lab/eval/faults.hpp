// Runs of the daemon's pipeline from a failing camera, through real packets on the loopback, to a sink; judgement of
// the results; fault scenarios with the expected result of each.
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
  const Recording* scene = nullptr;  // uint16 in kelvin at 10 mK; long enough for the run
  int rows_below = 0;                // blank rows of the sensor below the scene
  fakecam::FaultScript faults;
  genicam::CameraOptions camera;  // the address is also the fake camera's
  pipeline::PipelineOptions pipeline;
  double seconds = 1.0;  // from the first stream's start
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
  std::vector<fakecam::InjectedFault> injected;  // by the task's script
  fakecam::FakeCameraStats camera;
  std::vector<double> latency_ms;  // first packet received to published, of each frame
  // UDP packets that this computer dropped during the run because a socket buffer was full, of any program: if there
  // are any, frames may be missing that no fault took.
  std::uint64_t host_dropped = 0;
};

// The first frame of each stream of the fake camera; the next ones follow at one period and one number each.
inline constexpr std::int64_t kFirstCameraNs = 1'000'000'000;

// Options for a fake camera at an address: the scene's size and rate, packets so small that a frame has several, no
// waits for features that a fake lacks. Thread: any.
genicam::CameraOptions camera_options(const Recording& scene, const std::string& address);

// A new loopback address on each call; it contains the process id, so that programs can run in parallel. Thread: any.
std::string fresh_address();

// Errors: of camera, source or pipeline; a camera that never began to stream. Thread: setup.
Result<RunResult> run(const RunTask& task);

// The pipeline's result without faults: the deblurred plane of each frame, by number. Empty for frames without a full
// window. Thread: setup.
Result<std::vector<Counts>> undisturbed(const Recording& scene, const pipeline::PipelineOptions& options);

// --- Judgement of a run.

// Effects of faults on frames that still arrive, and their times in s after the first stream's start; negative if there
// is no single moment.
struct Disturbance {
  double from_s = -1.0;
  double to_s = -1.0;          // end of the last fault; from_s for momentary ones
  double clock_shift_s = 0.0;  // of the camera's clock, from then on
  int offset_counts = 0;       // of all pixels, from then on
};

struct Verdict {
  std::uint64_t right = 0;       // the deblurred plane equals that of an undisturbed run
  std::uint64_t warm_up = 0;     // flagged: no full window yet, the raw plane
  std::uint64_t gap = 0;         // flagged: another plane, because a frame of its window is lost
  std::uint64_t settling = 0;    // another plane without a flag, less than a window after the disturbance
  std::uint64_t wrong = 0;       // another plane without a flag and without an allowed reason
  std::uint64_t strange = 0;     // the raw plane is not in the scene
  std::uint64_t never_came = 0;  // unpublished frames between the first and the last of their stream
  bool recovered = false;        // the run ends with right frames
  // From the disturbance's end until only right frames are published; 0 if all of them were right, or nothing struck.
  double recovery_ms = 0.0;
};

// `reference`: from undisturbed(); `window`: frames. Thread: any.
Verdict judge(const RunResult& result, const Recording& scene, const std::vector<Counts>& reference, int window,
              const Disturbance& disturbance);

// Losses expected from the camera's own record of its faults. `resends`: lost packets are resent. Thread: any.
Losses expected_losses(const fakecam::FaultScript& script, const std::vector<fakecam::InjectedFault>& injected,
                       bool resends);

// --- Tested faults, one at a time.

// Expected results of a scenario, and its settings besides the faults.
struct Demands {
  bool resends = false;  // lost packets are requested and resent: most frames are saved
  int least_reconnects = 0;
  int most_reconnects = 0;
  // False: losses also depend on timing, such as the speed of resends or of a reconnect. Then each missing frame must
  // be counted, and no more is required.
  bool exact = true;
  std::function<void(RunTask&)> prepare = nullptr;  // further settings
};

struct Scenario {
  std::string name;
  std::string faults;  // for parse_fault(), separated by spaces
  double seconds = 1.0;
  Disturbance disturbance{};
  Demands demands{};
};

// All scenarios, with a small scene at 200 Hz. Thread: any.
const std::vector<Scenario>& scenarios();

// Input of all scenarios: 64x24 pixels of a passing street, and the result of an undisturbed run on it.
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

// Runs a scenario on its own camera, up to three times if this computer dropped packets by itself. `seed` selects the
// affected packets. Thread: any.
Result<Outcome> play(const Scenario& scenario, const Stage& stage, int seed = 1);

// Describes unmet demands; empty when all are met. Thread: any.
std::string unmet_demands(const Scenario& scenario, const Outcome& outcome);

// Such as "incomplete 12, missing 3", or "none". Thread: any.
std::string text_of(const Losses& losses);

// --- One run at one rate of packet loss.

struct LossTask {
  double rate = 0.01;  // share of packets
  bool resend = false;
  int packet_size = 1500;  // bytes
  double seconds = 4.0;
};

// Input of all trials: a street, 640x120 at 200 Hz. Thread: setup.
Result<Recording> loss_scene(double seconds);

// `scene`: from loss_scene(), long enough. Frames sent, those that lost a packet at first (frames_hit), those counted
// as lost on the way (network: incomplete, missing) and because deblurring was too slow (no slot, no room in the
// queue); errors of the received frames with a full window, against the truth. Thread: setup.
Result<Json> try_loss(const LossTask& task, const Recording& scene, const pipeline::PipelineOptions& options);

}  // namespace bolo::tools::faults

// Runs of the daemon's own way, from a failing camera, through real packets on the loopback, to a sink; judgement of
// their results; the scenarios of faults, and the expected result of each.
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
  genicam::CameraOptions camera;  // the address is the fake camera's too
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
  std::vector<fakecam::InjectedFault> injected;  // as in the task's script
  fakecam::FakeCameraStats camera;
  std::vector<double> latency_ms;  // first packet received to published, of each frame
  // UDP packets that this computer dropped meanwhile for want of room in a socket, whosever they were: when there are
  // any, frames may be missing that no fault took.
  std::uint64_t host_dropped = 0;
};

// The first frame of each stream of the fake camera; the others follow by periods and ones.
inline constexpr std::int64_t kFirstCameraNs = 1'000'000'000;

// Options for a fake camera at an address: the scene's size and rate, packets so small that frames have several,
// nothing that waits for what a fake does not need. Thread: any.
genicam::CameraOptions camera_options(const Recording& scene, const std::string& address);

// A loopback address that no other call has had; the process id is in it, so that programs run side by side.
// Thread: any.
std::string fresh_address();

// Errors: those of camera, source and pipeline; the camera that never began to stream. Thread: setup.
Result<RunResult> run(const RunTask& task);

// The pipeline's result without faults: the deblurred plane of each frame, by its number. Empty for frames without a
// full window. Thread: setup.
Result<std::vector<Counts>> undisturbed(const Recording& scene, const pipeline::PipelineOptions& options);

// --- Results of a run, judged.

// Effects of the faults on frames that still arrive, and their times: s after the first stream's start; before it when
// there is no single moment.
struct Disturbance {
  double from_s = -1.0;
  double to_s = -1.0;          // when the last of it is over; from_s for what is over at once
  double clock_shift_s = 0.0;  // of the camera's clock, from then on
  int offset_counts = 0;       // of all pixels, from then on
};

struct Verdict {
  std::uint64_t right = 0;       // the deblurred plane is that of an undisturbed run
  std::uint64_t warm_up = 0;     // flagged: no full window yet, the raw plane
  std::uint64_t gap = 0;         // flagged: another plane, for a frame of its window is lost
  std::uint64_t settling = 0;    // another plane without a flag, less than a window after the disturbance
  std::uint64_t wrong = 0;       // another plane without a flag and without excuse
  std::uint64_t strange = 0;     // the raw plane is none of the scene's
  std::uint64_t never_came = 0;  // frames between the first and the last of their stream that were not published
  bool recovered = false;        // the run ends with right frames
  // From the disturbance's end until only right frames are published; 0 when all of them were, or nothing struck.
  double recovery_ms = 0.0;
};

// `reference`: of undisturbed(); `window`: frames. Thread: any.
Verdict judge(const RunResult& result, const Recording& scene, const std::vector<Counts>& reference, int window,
              const Disturbance& disturbance);

// The losses expected from the camera's own record of its faults. `resends`: lost packets are sent again. Thread: any.
Losses expected_losses(const fakecam::FaultScript& script, const std::vector<fakecam::InjectedFault>& injected,
                       bool resends);

// --- The faults that are tried, one at a time.

// Expected results of a scenario, and its needs beside its faults.
struct Demands {
  bool resends = false;  // the daemon asks for lost packets and gets them: most frames are saved
  int least_reconnects = 0;
  int most_reconnects = 0;
  // False: losses depend on more than the fault: on how fast packets are requested and sent again, on when a camera is
  // reopened. Then each missing frame must be counted, and no more is demanded.
  bool exact = true;
  std::function<void(RunTask&)> prepare = nullptr;  // further settings
};

struct Scenario {
  std::string name;
  std::string faults;  // as parse_fault() reads them, with spaces between
  double seconds = 1.0;
  Disturbance disturbance{};
  Demands demands{};
};

// All of them, of a small scene at 200 Hz. Thread: any.
const std::vector<Scenario>& scenarios();

// Input of all scenarios: 64x24 pixels of a street that passes by, and an undisturbed run's result on it.
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

// Runs it on a camera of its own. Again, up to three times in all, when this computer dropped packets by itself.
// `seed`: another one chooses other packets. Thread: any.
Result<Outcome> play(const Scenario& scenario, const Stage& stage, int seed = 1);

// Describes unmet demands; empty when all are met. Thread: any.
std::string unmet_demands(const Scenario& scenario, const Outcome& outcome);

// "incomplete 12, missing 3", or "none". Thread: any.
std::string text_of(const Losses& losses);

// --- One run at one rate of packet loss.

struct LossTask {
  double rate = 0.01;  // share of the packets
  bool resend = false;
  int packet_size = 1500;  // bytes
  double seconds = 4.0;
};

// Input of all trials: a street, 640x120 at 200 Hz. Thread: setup.
Result<Recording> loss_scene(double seconds);

// `scene`: of loss_scene(), long enough. Frames sent, those of them that lost a packet at first (frames_hit), and those
// counted as lost on the way (network: incomplete, missing) and because deblurring was behind (no slot, no room in the
// queue); errors of the frames that came, against the truth, with a full window behind them. Thread: setup.
Result<Json> try_loss(const LossTask& task, const Recording& scene, const pipeline::PipelineOptions& options);

}  // namespace bolo::tools::faults

// The faults that are tried, one at a time, and what each must lead to.
#pragma once

#include <cstdint>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "tools/lab/eval/faults_run.hpp"

namespace bolo::tools::faults {

// What a scenario leads to, and what it needs beside its faults.
struct Demands {
  bool resends = false;  // the daemon asks for lost packets and gets them: most frames are saved
  int least_reconnects = 0;
  int most_reconnects = 0;
  // False: what is lost depends on more than the fault: on how fast packets are asked for and sent again, on when a
  // camera is opened again. Then each frame that never came must be counted, and no more is asked.
  bool exact = true;
  std::function<void(RunTask&)> prepare = nullptr;  // what else differs
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

// What all scenarios look at: 64x24 pixels of a street that passes by, and what an undisturbed run makes of it.
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

// What must hold and does not, in words; empty when all does. Thread: any.
std::string what_is_wrong(const Scenario& scenario, const Outcome& outcome);

// "incomplete 12, missing 3", or "none". Thread: any.
std::string text_of(const Losses& losses);

// --- One run at one rate of packet loss.

struct LossTask {
  double rate = 0.01;  // share of the packets
  bool resend = false;
  int packet_size = 1500;  // bytes
  double seconds = 4.0;
};

struct LossRow {
  double frames_per_s = 0.0;  // published
  std::uint64_t sent = 0;     // frames that the camera sent
  std::uint64_t hit = 0;      // of them, those that lost a packet at first
  std::uint64_t network = 0;  // counted as lost on the way: incomplete, missing
  std::uint64_t behind = 0;   // counted as lost because deblurring was behind: no slot, no room in the queue
  double deblur_ms = 0.0;     // of a frame
  double latency_p50_ms = 0.0;
  double latency_p99_ms = 0.0;
  double rmse_raw_k = 0.0;        // of the frames that came, against the truth
  double rmse_deblurred_k = 0.0;  // the same frames, with a full window behind them
  std::uint64_t host_dropped = 0;
};

// The street that all trials look at, 640x120 at 200 Hz. Thread: setup.
Result<Recording> loss_scene(double seconds);

// `scene`: of loss_scene(), long enough. Thread: setup.
Result<LossRow> try_loss(const LossTask& task, const Recording& scene, const pipeline::PipelineOptions& options);

}  // namespace bolo::tools::faults

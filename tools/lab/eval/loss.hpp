// One run at one rate of packet loss.
#pragma once

#include <cstdint>

#include "tools/lab/eval/faults_run.hpp"

namespace bolo::tools::faults {

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

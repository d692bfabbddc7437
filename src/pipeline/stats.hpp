// Counters of the pipeline, readable while it runs, and the row of each.
#pragma once

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <string_view>

#include "bolo/shm_layout.h"
#include "src/core/clock.hpp"
#include "src/core/gyro.hpp"
#include "src/pipeline/counter_row.hpp"
#include "src/pipeline/inlet.hpp"
#include "src/pipeline/quality_level.hpp"
#include "src/pipeline/source.hpp"
#include "src/rt/counters.hpp"

namespace bolo::pipeline {

// Latency of a frame by stage. Without look-ahead, arrival, queue and deblur add up to a frame's total latency; with
// look-ahead it also waits for the frames after it.
struct StageLatencies {
  rt::LatencyHistogram arrival;  // first byte received -> complete and in the frame queue
  rt::LatencyHistogram queue;    // in the queue -> taken by the pipeline thread
  rt::LatencyHistogram deblur;   // taken, or the frame before it published -> sharp
  rt::LatencyHistogram publish;  // sharp -> every sink has its copy
};

// Written by the pipeline thread, read by any.
struct PipelineStats {
  explicit PipelineStats(const FrameInlet& i, const SourceStatus* s = nullptr)
      : inlet(i), source(s), period_s(i.format().frame_period_s) {}

  // Received frames that were not taken yet. Thread: any.
  std::uint64_t waiting() const noexcept {
    const std::uint64_t gone = taken.value();  // read before the count it is subtracted from
    const std::uint64_t come = inlet.received();
    return come - std::min(gone, come);  // another thread may see the two counters in a different order
  }

  const FrameInlet& inlet;           // received(), losses()
  const SourceStatus* source;        // of a camera; null for a source that is not monitored
  rt::Gauge<double> period_s;        // used by the solver: the source's, or that of set_period()
  rt::Gauge<double> fresh_period_s;  // measured, without repeats, if these are dropped; 0: not known yet
  rt::Counter taken;                 // frames taken out of the queue
  rt::Counter published;             // frames handed to the sinks
  rt::Counter restarts;              // windows emptied: NUC, reconnect, a jump in time
  rt::Counter warm_up;               // published without a full window behind them
  rt::Counter gap_frames;            // published with a lost frame in their window
  std::array<rt::Counter, kQualityLevels>
      by_effort;                                // of the frames with a full window; their sum is published - warm_up
  rt::Gauge<QualityLevel> effort;               // of the last frame
  rt::Counter deblur_ns;                        // time spent solving, summed over frames
  rt::Counter repeats;                          // dropped frames that repeated the one before; also among the missing
  std::array<rt::Counter, kGyroUses> gyro;      // frames whose motion was estimated, by its use
  rt::Counter clock_steps;                      // times the host's clock was set
  rt::Gauge<std::uint64_t> clock_synchronised;  // 1: disciplined, according to the kernel
  rt::Gauge<std::int64_t> clock_error_ns{kUnboundedClockErrorNs};  // bound of its UTC error
  // Latest results of a GapWatch; ratios are 0 until known.
  rt::Counter gap_bursts;             // evaluated
  rt::Gauge<double> gap_ratio;        // of the prediction's error to the noise
  rt::Gauge<double> gap_tau_ratio;    // of the pixels' time constant to the profile's
  rt::Gauge<double> gap_noise_ratio;  // of the noise to the profile's
  rt::LatencyHistogram latency;       // first byte received -> publish_ns, right before the sinks get it
  StageLatencies stages;
  // CLOCK_MONOTONIC of the pipeline thread's last poll for a frame, at least ten times a second; 0: not running yet.
  rt::Gauge<std::int64_t> polled_ns;
};

inline std::uint64_t losses_word(const PipelineStats& stats, std::size_t part) noexcept {
  return stats.inlet.losses().value(static_cast<LossCause>(part));
}

inline std::uint64_t received_word(const PipelineStats& stats, std::size_t /*part*/) noexcept {
  return stats.inlet.received();
}

using FrameRow = CounterRow<PipelineStats>;
inline constexpr std::array kFrameCounters{
    FrameRow(received_word, offsetof(bolo_shm_header, received), "received", "bolo_frames_received_total",
             "Whole frames that reached the queue", AtEnd{true}),
    // Stored separately in shared memory, because readers find frames by it.
    FrameRow(word_of<&PipelineStats::published>, 0, "published", "bolo_frames_published_total",
             "Frames handed to the sinks", AtEnd{true}),
    FrameRow(losses_word, offsetof(bolo_shm_header, lost), "lost", "bolo_frames_lost_total",
             "Frames lost, by the first cause that took them", by<LossCause>("cause", kLossCauses), AtEnd{true}),
    FrameRow(word_of<&PipelineStats::repeats>, 0, "", "bolo_frames_repeated_total",
             "Frames dropped that repeated the one before; among the missing, too"),
    FrameRow(word_of<&PipelineStats::warm_up>, offsetof(bolo_shm_header, warm_up), "warm_up",
             "bolo_frames_warm_up_total", "Frames published without a full window behind them", InStat{"warm-up"}),
    FrameRow(word_of<&PipelineStats::gap_frames>, offsetof(bolo_shm_header, gap_frames), "gap_frames",
             "bolo_frames_gap_total", "Frames published with a lost one in their window", InStat{"with gaps"}),
    FrameRow(word_of<&PipelineStats::by_effort>, 0, "", "bolo_frames_effort_total",
             "Frames with a full window, by what was spent on them: less than full when too many were waiting",
             by<QualityLevel>("effort", kQualityLevels)),
    FrameRow(word_of<&PipelineStats::restarts>, offsetof(bolo_shm_header, restarts), "restarts",
             "bolo_window_restarts_total", "Windows emptied: NUC, reconnect, a jump in time", InStat{"restarts"}),
    FrameRow(word_of<&PipelineStats::deblur_ns>, offsetof(bolo_shm_header, deblur_ns)),
    FrameRow(word_of<&PipelineStats::gyro>, 0, "gyro", "bolo_frames_gyro_total",
             "Frames whose motion the gyro was asked for: used, no samples of their time, not in line with the picture",
             by<GyroUse>("use", kGyroUses)),
    FrameRow(word_of<&PipelineStats::clock_synchronised>, offsetof(bolo_shm_header, clock_synchronised), "",
             "bolo_clock_synchronised", "1 while something disciplines the host's clock, as its kernel says"),
    FrameRow(word_of<&PipelineStats::clock_error_ns>, offsetof(bolo_shm_header, clock_error_ns), "",
             "bolo_clock_error_seconds", "Of the host's UTC, at most; 16 s: nothing bounds it",
             Reading{RowKind::kNs, 1e-9, 1e-9}),
    FrameRow(word_of<&PipelineStats::clock_steps>, offsetof(bolo_shm_header, clock_steps), "clock_steps",
             "bolo_clock_steps_total", "Times that somebody set the host's clock"),
    FrameRow(word_of<&PipelineStats::gap_bursts>, 0, "gap_bursts", "bolo_gap_bursts_total",
             "Bursts of frames that were compared with the profile"),
    FrameRow(word_of<&PipelineStats::gap_ratio>, 0, "gap_ratio", "bolo_gap_ratio",
             "Error of the pixel model's prediction over the noise; 0: not told yet", Reading{RowKind::kReal}),
    FrameRow(word_of<&PipelineStats::gap_tau_ratio>, 0, "gap_tau_ratio", "bolo_gap_tau_ratio",
             "The pixels' time constant over the profile's; 0: not told yet", Reading{RowKind::kReal}),
    FrameRow(word_of<&PipelineStats::gap_noise_ratio>, 0, "gap_noise_ratio", "bolo_gap_noise_ratio",
             "The camera's noise over the profile's; 0: not told yet", Reading{RowKind::kReal}),
};

struct StageRow {
  std::string_view name;
  rt::LatencyHistogram StageLatencies::*latency;
};
inline constexpr std::array kStages{
    StageRow{"arrival", &StageLatencies::arrival}, StageRow{"queue", &StageLatencies::queue},
    StageRow{"deblur", &StageLatencies::deblur}, StageRow{"publish", &StageLatencies::publish}};

}  // namespace bolo::pipeline

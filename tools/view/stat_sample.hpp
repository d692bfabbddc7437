// Contents of `bolo stat`: the difference of two snapshots of a daemon's shared memory, as numbers, text and JSON.
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <string>

#include <nlohmann/json.hpp>

#include "bolo/shm_layout.h"
#include "drivers/shm/shm_reader.hpp"
#include "src/core/loss.hpp"

namespace bolo::tools {

// Motion up to the newest frame.
struct StatMotion {
  double x_px = 0.0;  // a frame, of the whole picture at its centre
  double y_px = 0.0;
  double sure = 0.0;  // share of the blocks with a confidence of at least a half
};
// Nothing where that frame carries none. Thread: any.
std::optional<StatMotion> newest_motion(const shm::ShmReader& reader);

// Thread: any.
struct StatSnapshot {
  bolo_shm_header header{};
  std::int64_t at_ns = 0;                   // CLOCK_MONOTONIC
  bool closed = false;                      // ended, or its heartbeat stopped
  std::optional<bolo_shm_camera> camera{};  // none: the writer does not publish it
  std::optional<StatMotion> motion{};       // none: not known
  // The daemon's answer to `state` on its control socket; null when it has none, or does not answer.
  nlohmann::ordered_json status{};
};

struct StatSample {
  double interval_s = 0.0;
  double received_hz = 0.0;
  double published_hz = 0.0;
  std::array<std::uint64_t, kLossCauses> lost{};  // since the daemon's start
  std::array<double, kLossCauses> lost_hz{};      // in the interval
  std::uint64_t lost_total = 0;
  std::uint64_t latency_frames = 0;  // frames behind the percentiles: those of the interval
  double latency_p50_ms = 0.0;
  double latency_p99_ms = 0.0;
  double latency_max_ms = 0.0;
  double deblur_ms = 0.0;  // a frame, over those of the interval that had a full window; 0 when none had
  double uptime_s = 0.0;
  double heartbeat_age_s = 0.0;
  const char* state = "";  // starting, running, closed (ended in good order), stopped (killed or frozen)
};

// Both snapshots of the same object, `before` first. Thread: any.
StatSample compare(const StatSnapshot& before, const StatSnapshot& after);

// A table of lines of at most 79 characters, each ended. Thread: any.
std::string stat_table(const std::string& name, const StatSnapshot& snapshot, const StatSample& sample);

// Keys in snake_case, unit in the name. Thread: any.
nlohmann::ordered_json stat_json(const std::string& name, const StatSnapshot& snapshot, const StatSample& sample);

}  // namespace bolo::tools

// Contents of `bolo stat`: differences between two snapshots of a daemon's shared memory, as numbers, text and JSON.
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

// The scene's motion up to the newest frame.
struct StatMotion {
  double x_px = 0.0;  // px per frame, of the whole picture at its centre
  double y_px = 0.0;
  double sure = 0.0;  // share of blocks with a confidence of at least one half
};
// Nothing if that frame carries no motion. Thread: any.
std::optional<StatMotion> newest_motion(const shm::ShmReader& reader);

struct StatSnapshot {
  bolo_shm_header header{};
  std::int64_t at_ns = 0;                   // CLOCK_MONOTONIC
  bool closed = false;                      // ended, or without heartbeat
  std::optional<bolo_shm_camera> camera{};  // nothing: the writer does not publish it
  std::optional<StatMotion> motion{};       // nothing: unknown
  // The daemon's answer to `state` on its control socket; null without a socket or an answer.
  nlohmann::ordered_json status{};
};

struct StatSample {
  double interval_s = 0.0;
  double received_hz = 0.0;
  double published_hz = 0.0;
  std::array<std::uint64_t, kLossCauses> lost{};  // since the daemon's start
  std::array<double, kLossCauses> lost_hz{};      // in the interval
  std::uint64_t lost_total = 0;
  std::uint64_t latency_frames = 0;  // number of frames in the interval, on which the percentiles rest
  double latency_p50_ms = 0.0;
  double latency_p99_ms = 0.0;
  double latency_max_ms = 0.0;
  double deblur_ms = 0.0;  // per frame with a full window in the interval; 0: none
  double uptime_s = 0.0;
  double heartbeat_age_s = 0.0;
  const char* state = "";  // starting, running, closed (ended properly), stopped (killed or frozen)
};

// Both snapshots must be of the same object, `before` first. Thread: any.
StatSample compare(const StatSnapshot& before, const StatSnapshot& after);

// A table of terminated lines of at most 79 characters. Thread: any.
std::string stat_table(const std::string& name, const StatSnapshot& snapshot, const StatSample& sample);

// Keys in snake_case, with units in names. Thread: any.
nlohmann::ordered_json stat_json(const std::string& name, const StatSnapshot& snapshot, const StatSample& sample);

}  // namespace bolo::tools

// The daemon's state as JSON, for the control socket.
#pragma once

#include <nlohmann/json.hpp>

#include <string>

#include "src/pipeline/stats.hpp"
#include "tools/bolod/compose.hpp"

namespace bolo::daemon {

// Percentiles of where a frame's time goes, by stage: {"arrival": {"p50_ms": .., "p99_ms": .., "max_ms": ..}, ...}.
// Thread: any.
nlohmann::ordered_json stages_json(const pipeline::PipelineStats& stats);

// Counters of frames, stages, camera and video devices. Thread: any.
nlohmann::ordered_json state_json(const std::string& name, const pipeline::PipelineStats& stats,
                                  const std::array<v4l2::V4l2Sink*, kVideoDevices>& video);

}  // namespace bolo::daemon

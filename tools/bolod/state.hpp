// The daemon's state as JSON, for the control socket.
#pragma once

#include <nlohmann/json.hpp>

#include "tools/bolod/config.hpp"

namespace bolo::daemon {

// Counts of frames, latency by stage ({"arrival": {"p50_ms": .., "p99_ms": .., "max_ms":
// ..}, ...}), camera and sinks. Thread: any.
nlohmann::ordered_json state_json(const DaemonConfig& config, const pipeline::Pipeline& pipeline);

}  // namespace bolo::daemon

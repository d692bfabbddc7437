// A soak: camera, daemon and readers as processes of their own, disturbed as the schedule says, watched all the time.
#pragma once

#include <atomic>
#include <functional>
#include <string>

#include "tools/lab/soak/findings.hpp"
#include "tools/lab/soak/rig.hpp"
#include "tools/lab/soak/verdicts.hpp"

namespace bolo::tools::soak {

struct SoakRequest {
  RigRequest rig;
  Schedule schedule;
  double latency_limit_ms = 100.0;  // of 99 % of the frames of quiet times
  double growth_limit_mib = 1.0;
};

// `progress` gets a line every few seconds. The findings outlive the call. An error: it could not be set up.
// Thread: setup.
Result<SoakResult> run_soak(const SoakRequest& request, const Programs& programs, const std::atomic<bool>& stop,
                            const std::function<void(const std::string&)>& progress, Findings& findings);

}  // namespace bolo::tools::soak

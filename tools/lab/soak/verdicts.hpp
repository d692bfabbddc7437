// What the seconds of a soak, taken together, say.
#pragma once

#include <string>
#include <vector>

#include "tools/lab/soak/findings.hpp"
#include "tools/lab/soak/result.hpp"

namespace bolo::tools::soak {

// Of the processors' time: where other programs took more, times are their doing, and are told but not judged.
inline constexpr double kMostOthers = 0.15;

// Thread: any.
LatencyFigures figures_of(const std::vector<double>& latency_ms);

// The most that other programs took in any full second since then. Thread: any.
double others_since(const std::vector<Second>& timeline, double from_s);

// Frames lost for want of time in the last second but one, though none was published as it came, in it or beside it:
// before that there is no time to react. 0: all is well. Thread: any.
std::uint64_t lost_too_early(const std::vector<Second>& timeline);

// Fill in the result's figures and judge them. Thread: any.
void judge_latency(const std::vector<double>& quiet_ms, double limit_ms, SoakResult& result, Findings& findings);
void judge_growth(double limit_mib, SoakResult& result, Findings& findings);

}  // namespace bolo::tools::soak

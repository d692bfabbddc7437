// How far a figure would scatter if other scenes had been taken: the percentile bootstrap (Efron, "Bootstrap methods:
// another look at the jackknife", 1979). Scenes are drawn anew, with replacement, each with all its images.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

namespace bolo::tools::detect {

// How often each of `scenes` scenes is drawn in the draw number `draw`; they sum to `scenes`. Thread: any.
std::vector<int> drawn_scenes(std::size_t scenes, std::uint64_t seed, std::uint64_t draw);

struct Interval {
  double low = 0.0;
  double high = 0.0;
};

// The middle 95 % of the values that are numbers; NaN twice where there are none. Thread: any.
Interval interval_95(std::vector<double> values);

}  // namespace bolo::tools::detect

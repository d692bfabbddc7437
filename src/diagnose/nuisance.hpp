// The stimulus' own errors as coordinates: always fitted, never counted as the camera's gap.
#pragma once

#include <vector>

#include "effect.hpp"

namespace bolo::diagnose {

// Owners of what several recordings share.
inline constexpr int kAllBars = -1;
inline constexpr int kAllRecordings = -2;

struct Nuisance {
  Coordinate coordinate;
  int recording = kAllBars;
  bool is_level = false;  // shares its prior with all other levels
  double nominal = 0.0;
  double prior = 0.0;  // standard deviation about `nominal`; 0: free. Levels: see level_spread()
};

std::vector<Nuisance> nuisances(const Session& session, const State& nominal);

inline constexpr double kSoftestEdge_px = 0.35;  // of a target, standard deviation

// Levels that agree with the files to a few millikelvin say so together: their spread is estimated from themselves.
inline constexpr double kLevelResolution = 0.005;  // K
double level_spread(const std::vector<Nuisance>& all, const State& state);

// Log-likelihood (up to a constant) of the levels' errors, their common spread unknown.
double level_evidence(const std::vector<Nuisance>& all, const State& state);

}  // namespace bolo::diagnose

// Nested least-squares fits of camera and stimulus, judged on held-out cells.
#pragma once

#include <functional>
#include <span>
#include <string>
#include <vector>

#include "src/diagnose/equations.hpp"
#include "src/diagnose/unknowns.hpp"

namespace bolo::diagnose {

struct FitResult {
  State state;
  Score score;
  std::vector<Choice> choices;
  std::vector<std::vector<double>> value;  // of each choice's parameters
  std::vector<std::vector<double>> error;
};

// Fits the stimulus, and the parameters and maps of `choices`, from `start` on.
FitResult fit(const FitData& data, const State& start, const std::vector<Choice>& choices, int rounds);

// Once more, `rounds` at a time, until the gap changes by no more than the share `tolerance`.
FitResult settle(const FitData& data, FitResult from, int rounds, double tolerance);

// What each candidate would gain on held-out cells, by the linear model around a fit: cheap, so that only the best are
// fitted in earnest.
std::vector<Gain> screen(const FitData& data, const FitResult& base, const std::vector<Choice>& candidates);

// Forward selection of effects with nested refits, then backward.
struct Chosen {
  Choice choice;
  double gap_before = 0.0;
  double gap_after = 0.0;
  Gain gain;
  std::vector<Alternative> alternatives;
  double confidence = 0.0;
  bool from_map = false;  // seen in the map of another, which had explained it away
};

struct Selection {
  FitResult fit;
  std::vector<Chosen> chosen;  // in the order of finding; gaps are nested
};

// What an effect must gain on held-out cells, in units of log-likelihood, and how even over groups.
inline constexpr double kLeastGain = 20.0;
inline constexpr double kLeastZ = 2.2;

// `allowed` says which effects of the catalogue may be chosen at all. `progress` is told what is being tried.
Selection select_effects(const FitData& data, const FitResult& base, const std::function<bool(const Effect&)>& allowed,
                         const std::function<bool(const std::string& step, double done)>& progress);

}  // namespace bolo::diagnose

// Forward selection of effects with nested refits, then backward.
#pragma once

#include <functional>
#include <string>
#include <vector>

#include "fit.hpp"

namespace bolo::diagnose {

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

// `allowed` says which effects of the catalogue may be chosen at all. `step` is told what is being tried.
Selection select_effects(const Fitter& fitter, const FitResult& base, const std::function<bool(const Effect&)>& allowed,
                         const std::function<bool(const std::string& step, double done)>& progress);

}  // namespace bolo::diagnose

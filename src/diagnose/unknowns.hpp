// What a fit solves for: the errors of the stimulus, always fitted and never counted as the camera's gap, then the
// parameters of the effects.
#pragma once

#include <span>
#include <vector>

#include <Eigen/Core>

#include "src/diagnose/effect.hpp"

namespace bolo::diagnose {

// Owners of what several recordings share.
inline constexpr int kAllBars = -1;
inline constexpr int kAllRecordings = -2;

struct Nuisance {
  Parameter parameter;
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

// An effect in one of its forms.
struct Choice {
  const Effect* effect = nullptr;
  int form = -1;  // -1: as the state has it
};

// The same effects, their forms as they are in the state already.
std::vector<Choice> unformed(std::vector<Choice> choices);

struct Unknowns {
  std::vector<Nuisance> nuisances;
  std::vector<Parameter> parameters;  // of nuisances, then of the choices
  std::vector<std::size_t> first;     // of each choice, and one past the last

  Unknowns(const Session& session, const State& nominal, std::span<const Choice> choices);

  // Of one recording: those that cannot change it have no step. `of`: the parameters, or these and more.
  std::vector<Parameter> touching(const Session& session, std::size_t recording, std::vector<Parameter> of) const;

  // The prior of the stimulus: precision on the diagonal, and its pull on the right side.
  void add_prior(const State& state, Eigen::MatrixXd& normal, Eigen::VectorXd& right) const;
};

// What the files say of the stimuli, with the frame filter of `state`.
State nominal_of(const Session& session, const State& state);

}  // namespace bolo::diagnose

// What a fit solves for: the errors of the stimulus, then the coordinates of the effects.
#pragma once

#include <span>
#include <vector>

#include <Eigen/Core>

#include "effect.hpp"
#include "nuisance.hpp"

namespace bolo::diagnose {

// An effect in one of its forms.
struct Choice {
  const Effect* effect = nullptr;
  int form = -1;  // -1: as the state has it
};

// The same effects, their forms as they are in the state already.
std::vector<Choice> unformed(std::vector<Choice> choices);

struct Unknowns {
  std::vector<Nuisance> nuisances;
  std::vector<Coordinate> coordinates;  // of nuisances, then of the choices
  std::vector<std::size_t> first;       // of each choice, and one past the last

  Unknowns(const Session& session, const State& nominal, std::span<const Choice> choices);

  // Of one recording: those that cannot change it have no step. `of`: the coordinates, or these and more.
  std::vector<Coordinate> touching(const Session& session, std::size_t recording, std::vector<Coordinate> of) const;

  // The prior of the stimulus: precision on the diagonal, and its pull on the right side.
  void add_prior(const State& state, Eigen::MatrixXd& normal, Eigen::VectorXd& right) const;
};

// What the files say of the stimuli, with the frame filter of `state`.
State nominal_of(const Session& session, const State& state);

}  // namespace bolo::diagnose

#include "unknowns.hpp"

namespace bolo::diagnose {
namespace {

bool touches(int owner, const Session& session, std::size_t recording) {
  if (owner == kAllRecordings) return true;
  if (owner >= 0) return static_cast<std::size_t>(owner) == recording;
  const Kind kind = session.recordings[recording].kind;
  return kind == Kind::kStillBars || kind == Kind::kMovingBars;
}

}  // namespace

std::vector<Choice> unformed(std::vector<Choice> choices) {
  for (Choice& c : choices) c.form = -1;
  return choices;
}

Unknowns::Unknowns(const Session& session, const State& nominal, std::span<const Choice> choices)
    : nuisances(diagnose::nuisances(session, nominal)) {
  for (const Nuisance& n : nuisances) coordinates.push_back(n.coordinate);
  for (const Choice& choice : choices) {
    first.push_back(coordinates.size());
    if (!choice.effect->coordinates) continue;
    for (Coordinate& c : choice.effect->coordinates(session)) coordinates.push_back(std::move(c));
  }
  first.push_back(coordinates.size());
}

std::vector<Coordinate> Unknowns::touching(const Session& session, std::size_t recording,
                                           std::vector<Coordinate> of) const {
  for (std::size_t j = 0; j < nuisances.size(); ++j) {
    if (!touches(nuisances[j].recording, session, recording)) of[j].step = 0.0;
  }
  return of;
}

void Unknowns::add_prior(const State& state, Eigen::MatrixXd& normal, Eigen::VectorXd& right) const {
  const double spread = level_spread(nuisances, state);
  for (std::size_t i = 0; i < nuisances.size(); ++i) {
    const Nuisance& n = nuisances[i];
    const double width = n.is_level ? spread : n.prior;
    if (width <= 0.0) continue;
    const auto j = static_cast<Eigen::Index>(i);
    normal(j, j) += 1.0 / (width * width);
    right[j] += (n.nominal - n.coordinate.get(state)) / (width * width);
  }
}

State nominal_of(const Session& session, const State& state) {
  State nominal = nominal_state(session, {});
  nominal.camera.response.filter = state.camera.response.filter;
  nominal.camera.response.alpha = state.camera.response.alpha;
  for (std::size_t i = 0; i < nominal.stimuli.size(); ++i) nominal.stimuli[i].times_free = state.stimuli[i].times_free;
  return nominal;
}

}  // namespace bolo::diagnose

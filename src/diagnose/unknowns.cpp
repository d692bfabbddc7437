#include "src/diagnose/unknowns.hpp"

#include <algorithm>
#include <cmath>

namespace bolo::diagnose {
namespace {

Parameter member(std::string name, std::size_t i, double StimulusState::*field, double step, double limit) {
  const auto get = [i, field](const State& s) { return s.stimuli[i].*field; };
  return {std::move(name), step, -limit, limit, get, [i, field](State& s, double v) { s.stimuli[i].*field = v; }};
}

Parameter level(std::size_t i, std::size_t which, double nominal) {
  constexpr double kReach = 30.0;  // K
  const auto get = [i, which](const State& s) { return s.stimuli[i].level_k[which]; };
  const auto set = [i, which](State& s, double value) { s.stimuli[i].level_k[which] = value; };
  return {"level", 1.0, nominal - kReach, nominal + kReach, get, set};
}

// The softness' square, s^2: a symmetric ramp changes the response to second order only.
Parameter softness(std::size_t i) {
  const auto get = [i](const State& s) { return s.stimuli[i].softness_s * s.stimuli[i].softness_s; };
  const auto set = [i](State& s, double value) { s.stimuli[i].softness_s = std::sqrt(std::max(0.0, value)); };
  return {"softness", 1e-6, 0.0, 2.5e-5, get, set};
}

// Of the standard deviation, not the variance: where an edge just reaches a pixel it shows to first order.
Parameter target_edge() {
  const auto get = [](const State& s) {
    const auto soft = std::ranges::find_if(s.stimuli, [](const StimulusState& one) { return one.edge_px2 != 0.0; });
    return soft == s.stimuli.end() ? 0.0 : std::sqrt(soft->edge_px2);
  };
  const auto set = [](State& s, double value) {
    for (StimulusState& stimulus : s.stimuli) stimulus.edge_px2 = value * value;
  };
  return {"edge", 0.04, 0.0, kSoftestEdge_px, get, set};
}

bool touches(int owner, const Session& session, std::size_t recording) {
  if (owner == kAllRecordings) return true;
  if (owner >= 0) return static_cast<std::size_t>(owner) == recording;
  const Kind kind = session.recordings[recording].kind;
  return kind == Kind::kStillBars || kind == Kind::kMovingBars;
}

}  // namespace

std::vector<Nuisance> nuisances(const Session& session, const State& nominal) {
  constexpr double kEdgePrior = 0.2;  // px
  std::vector<Nuisance> all;
  bool bars = false;
  for (std::size_t i = 0; i < session.recordings.size(); ++i) {
    const Recording& recording = session.recordings[i];
    if (!has_model(recording)) continue;
    const StimulusState& stimulus = nominal.stimuli[i];
    const int index = static_cast<int>(i);
    for (std::size_t l = 0; l < stimulus.level_k.size(); ++l) {
      all.push_back({level(i, l, stimulus.level_k[l]), index, true, stimulus.level_k[l], 0.0});
    }
    if (recording.kind == Kind::kChopper) {
      // Frames whose times are free tell no common delay.
      const bool common = !stimulus.times_free;
      if (common) all.push_back({member("delay", i, &StimulusState::delay_s, 0.0005, 0.05), index, false, 0.0, 0.0});
      all.push_back({member("sweep", i, &StimulusState::sweep_s, 0.001, 0.03), index, false, 0.0, 0.005});
      if (common) all.push_back({softness(i), index, false, 0.0, 2e-6});
    }
    if (recording.kind == Kind::kStillBars) {
      all.push_back({member("phase", i, &StimulusState::phase_px, 0.05, 1e6), index, false, 0.0, 0.0});
    }
    bars = bars || recording.kind == Kind::kStillBars || recording.kind == Kind::kMovingBars;
  }
  if (nominal.camera.response.filter != FrameFilter::kNone && nominal.camera.response.alpha < 1.0) {
    // Known from the noise to a percent; the late edges tell it better.
    all.push_back({{"alpha", 0.02, 0.05, 1.0, [](const State& s) { return s.camera.response.alpha; },
                    [](State& s, double value) { s.camera.response.alpha = value; }},
                   kAllRecordings,
                   false,
                   1.0,
                   0.0});
  }
  if (bars) all.push_back({target_edge(), kAllBars, false, 0.0, kEdgePrior});
  return all;
}

double level_spread(const std::vector<Nuisance>& all, const State& state) {
  double sum = 0.0;
  double count = 0.0;
  for (const Nuisance& n : all) {
    if (!n.is_level) continue;
    const double error = n.parameter.get(state) - n.nominal;
    sum += error * error;
    count += 1.0;
  }
  return std::sqrt(sum / std::max(1.0, count) + kLevelResolution * kLevelResolution);
}

double level_evidence(const std::vector<Nuisance>& all, const State& state) {
  const auto count = static_cast<double>(std::ranges::count_if(all, &Nuisance::is_level));
  return -count * std::log(level_spread(all, state) / kLevelResolution);
}

std::vector<Choice> unformed(std::vector<Choice> choices) {
  for (Choice& c : choices) c.form = -1;
  return choices;
}

Unknowns::Unknowns(const Session& session, const State& nominal, std::span<const Choice> choices)
    : nuisances(diagnose::nuisances(session, nominal)) {
  for (const Nuisance& n : nuisances) parameters.push_back(n.parameter);
  for (const Choice& choice : choices) {
    first.push_back(parameters.size());
    if (!choice.effect->parameters) continue;
    for (Parameter& c : choice.effect->parameters(session)) parameters.push_back(std::move(c));
  }
  first.push_back(parameters.size());
}

std::vector<Parameter> Unknowns::touching(const Session& session, std::size_t recording,
                                          std::vector<Parameter> of) const {
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
    right[j] += (n.nominal - n.parameter.get(state)) / (width * width);
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

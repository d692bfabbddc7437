#include "src/diagnose/fit.hpp"

#include <algorithm>
#include <cmath>

#include "src/diagnose/pixel_maps.hpp"
#include "src/diagnose/timing.hpp"

namespace bolo::diagnose {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

constexpr double kLargestStep = 8.0;      // of a parameter in one round, in units of its typical size
constexpr double kLargestShift_px = 1.0;  // of moving bars in one round
constexpr double kLargestLateness_s = 0.0005;

// The linear model of all recordings around a state.
struct Linear {
  std::vector<Columns> columns;
  std::vector<std::vector<Group>> groups;
};

struct NewtonStep {
  VectorXd by;
  MatrixXd normal;      // with the prior
  double excess = 1.0;  // of the squared residual over the noise
};

Linear linearise(const FitData& data, const State& state, const Unknowns& u, const std::vector<Parameter>& parameters) {
  Linear linear;
  linear.columns.resize(data.session.recordings.size());
  linear.groups.resize(data.session.recordings.size());
  for_each_index(data.session.recordings.size(), data.threads, [&](std::size_t i) {
    if (!has_model(data.session.recordings[i])) return;
    Columns& columns = linear.columns[i] = columns_of(data, i, state, u.touching(data.session, i, parameters));
    linear.groups[i] = groups_of(data.session, columns.residual, columns.column, data.fit_pixels);
  });
  return linear;
}

NewtonStep step_of(const Linear& linear, const Unknowns& u, const State& state) {
  const auto count = static_cast<Index>(u.parameters.size());
  MatrixXd normal = MatrixXd::Zero(count, count);
  VectorXd right = VectorXd::Zero(count);
  double squares = 0.0;
  double weights = 1.0;
  for (const auto& of : linear.groups) {
    for (const Group& g : of) {
      normal += g.train.topLeftCorner(count, count);
      right += g.train.topRightCorner(count, 1);
      squares += g.train(count, count);
    }
  }
  for (const Columns& columns : linear.columns) {
    if (columns.residual.size() > 0) weights += static_cast<double>((columns.residual.array() != 0.0F).count()) / 2.0;
  }
  // The prior speaks in nats of a well-predicted session; where nothing fits it would be lost, so it keeps its weight.
  NewtonStep step;
  step.excess = std::max(1.0, squares / weights);
  step.normal = normal / step.excess;
  right /= step.excess;
  u.add_prior(state, step.normal, right);
  VectorXd low(count);
  VectorXd high(count);
  for (std::size_t j = 0; j < u.parameters.size(); ++j) {
    const Parameter& c = u.parameters[j];
    const double limit = kLargestStep * c.step;
    low[static_cast<Index>(j)] = std::max(-limit, std::min(0.0, c.low - c.get(state)));
    high[static_cast<Index>(j)] = std::min(limit, std::max(0.0, c.high - c.get(state)));
  }
  step.by = solve_within(step.normal, right, low, high);
  return step;
}

// Frames that do not count were not fitted: their shifts follow from those of their neighbours.
void fill_unseen_shifts(const FitData& data, State& state) {
  for (std::size_t i = 0; i < data.session.recordings.size(); ++i) {
    const Recording& r = data.session.recordings[i];
    if (r.kind != Kind::kMovingBars) continue;
    StimulusState& s = state.stimuli[i];
    std::vector<std::size_t> seen;
    for (std::size_t k = 0; k < r.used.size(); ++k) {
      if (data.frame_counts(i, k)) seen.push_back(k);
    }
    if (seen.empty()) continue;
    const auto time = [&](std::size_t k) { return r.t[k] + s.late_s[k]; };
    for (std::size_t k = 0; k < r.used.size(); ++k) {
      if (data.frame_counts(i, k)) continue;
      const auto next = std::ranges::lower_bound(seen, k);
      const std::size_t near = next == seen.end() ? seen.back() : *next;
      s.shift_px[k] = s.shift_px[near] + s.speed_px_s[near] * (time(k) - time(near));
    }
  }
}

void take(const FitData& data, const NewtonStep& step, const Linear& linear, const Unknowns& u, State& state) {
  for (std::size_t j = 0; j < u.parameters.size(); ++j) {
    const Parameter& c = u.parameters[j];
    c.set(state, c.get(state) + step.by[static_cast<Index>(j)]);
  }
  for (std::size_t i = 0; i < linear.columns.size(); ++i) {
    const Columns& columns = linear.columns[i];
    for (std::size_t k = 0; k < columns.shift.size(); ++k) {
      double shift = columns.shift[k];
      for (std::size_t j = 0; j < columns.turn.size(); ++j) {
        shift -= columns.turn[j][k] * step.by[static_cast<Index>(j)];
      }
      StimulusState& stimulus = state.stimuli[i];
      if (data.session.recordings[i].kind == Kind::kMovingBars) {
        stimulus.shift_px[k] += std::clamp(shift, -kLargestShift_px, kLargestShift_px);
      } else {
        stimulus.late_s[k] += std::clamp(shift, -kLargestLateness_s, kLargestLateness_s);
      }
    }
  }
  fill_unseen_shifts(data, state);
  smooth_speeds(data.session, state);
}

// Standard errors of the unknowns: from the noise, or from the scatter of the groups where that says more.
VectorXd errors_of(const std::vector<std::vector<Group>>& groups, const MatrixXd& normal, const VectorXd& by,
                   double excess) {
  const Index count = by.size();
  const MatrixXd spread = inverse(normal);
  MatrixXd outer = MatrixXd::Zero(count, count);
  for (const auto& of : groups) {
    for (const Group& g : of) {
      const VectorXd gradient = g.train.topRightCorner(count, 1) - g.train.topLeftCorner(count, count) * by;
      outer += gradient * gradient.transpose();
    }
  }
  const MatrixXd robust = spread * (outer / (excess * excess)) * spread;
  return spread.diagonal().cwiseMax(robust.diagonal()).cwiseMax(0.0).cwiseSqrt();
}

// The candidate's parameters; its form takes effect together with them, so that the base stays as it is.
std::vector<Parameter> parameters_of(const Session& session, const Choice& candidate) {
  if (!candidate.effect->parameters) return {};
  std::vector<Parameter> all = candidate.effect->parameters(session);
  if (candidate.form < 0) return all;
  for (Parameter& c : all) {
    const auto begin = candidate.effect->forms[static_cast<std::size_t>(candidate.form)].begin;
    c.set = [set = c.set, begin](State& s, double value) {
      begin(s);
      set(s, value);
    };
  }
  return all;
}

// Training equations of all unknowns, held-out ones by group.
struct Wide {
  const Unknowns& base;
  const State& state;
  std::vector<Parameter> parameters;  // the base's, then those of the candidates
  MatrixXd normal;                    // augmented
  std::vector<const MatrixXd*> test;  // augmented, of each group

  // Squared residual of each group when the parameters `chosen` are solved for.
  std::vector<double> loss(const std::vector<Index>& chosen) const {
    MatrixXd a = normal(chosen, chosen);
    VectorXd b = normal(chosen, normal.cols() - 1);
    base.add_prior(state, a, b);
    const auto size = static_cast<Index>(chosen.size());
    VectorXd low(size);
    VectorXd high(size);
    for (Index r = 0; r < size; ++r) {
      const Parameter& c = parameters[static_cast<std::size_t>(chosen[static_cast<std::size_t>(r)])];
      low[r] = std::min(0.0, c.low - c.get(state));
      high[r] = std::max(0.0, c.high - c.get(state));
    }
    const VectorXd x = solve_within(a, b, low, high);
    std::vector<double> losses;
    losses.reserve(test.size());
    for (const MatrixXd* of : test) {
      const Index last = of->cols() - 1;
      double sum = (*of)(last, last);
      for (Index r = 0; r < size; ++r) {
        const Index i = chosen[static_cast<std::size_t>(r)];
        sum -= 2.0 * x[r] * (*of)(i, last);
        for (Index c = 0; c < size; ++c) sum += x[r] * x[c] * (*of)(i, chosen[static_cast<std::size_t>(c)]);
      }
      losses.push_back(sum);
    }
    return losses;
  }
};

}  // namespace

FitResult fit(const FitData& data, const State& start, const std::vector<Choice>& choices, int rounds) {
  FitResult result;
  result.state = start;
  result.choices = choices;
  for (const Choice& choice : choices) {
    if (choice.form >= 0) choice.effect->forms[static_cast<std::size_t>(choice.form)].begin(result.state);
  }
  const Unknowns u(data.session, nominal_of(data.session, start), choices);
  const bool maps = std::ranges::any_of(choices, [](const Choice& c) { return c.effect->map != MapKind::kNone; });
  VectorXd errors = VectorXd::Zero(static_cast<Index>(u.parameters.size()));
  for (int round = 0; round < rounds; ++round) {
    const Linear linear = linearise(data, result.state, u, u.parameters);
    const NewtonStep step = step_of(linear, u, result.state);
    take(data, step, linear, u, result.state);
    if (maps) result.state = estimate_maps(data, std::move(result.state), choices);
    if (round + 1 == rounds) errors = errors_of(linear.groups, step.normal, step.by, step.excess);
  }
  for (std::size_t c = 0; c < choices.size(); ++c) {
    auto& values = result.value.emplace_back();
    auto& spreads = result.error.emplace_back();
    for (std::size_t j = u.first[c]; j < u.first[c + 1]; ++j) {
      values.push_back(u.parameters[j].get(result.state));
      spreads.push_back(errors[static_cast<Index>(j)]);
    }
  }
  result.score = data.score(result.state);
  return result;
}

FitResult settle(const FitData& data, FitResult from, int rounds, double tolerance) {
  constexpr int kMostTimes = 4;
  for (int time = 0; time < kMostTimes; ++time) {
    FitResult next = fit(data, from.state, unformed(from.choices), rounds);
    const bool still = std::abs(next.score.gap() / from.score.gap() - 1.0) < tolerance;
    from = std::move(next);
    if (still) break;
  }
  return from;
}

std::vector<Gain> screen(const FitData& data, const FitResult& base, const std::vector<Choice>& candidates) {
  const Unknowns u(data.session, nominal_of(data.session, base.state), base.choices);
  Wide wide{u, base.state, u.parameters, {}, {}};
  std::vector<std::vector<Index>> places;  // of each candidate's parameters
  for (const Choice& candidate : candidates) {
    auto& own = places.emplace_back();
    for (Parameter& c : parameters_of(data.session, candidate)) {
      own.push_back(static_cast<Index>(wide.parameters.size()));
      wide.parameters.push_back(std::move(c));
    }
  }
  const Linear linear = linearise(data, base.state, u, wide.parameters);
  const auto size = static_cast<Index>(wide.parameters.size()) + 1;
  wide.normal = MatrixXd::Zero(size, size);
  for (const auto& of : linear.groups) {
    for (const Group& g : of) {
      wide.normal += g.train;
      wide.test.push_back(&g.test);
    }
  }
  // The fit's pixels stand for all.
  const double scale = static_cast<double>(data.all_pixels.size()) / static_cast<double>(data.fit_pixels.size());
  std::vector<Index> chosen;
  for (std::size_t j = 0; j < u.parameters.size(); ++j) chosen.push_back(static_cast<Index>(j));
  const std::vector<double> before = wide.loss(chosen);
  std::vector<Gain> gains(candidates.size());
  for (std::size_t i = 0; i < candidates.size(); ++i) {
    if (candidates[i].effect->map != MapKind::kNone && !candidates[i].effect->parameters) {
      gains[i] = gain_between(base.score, map_gain(data, base.state, base.score, candidates[i].effect->map));
      continue;
    }
    if (places[i].empty()) continue;
    std::vector<Index> more = chosen;
    more.insert(more.end(), places[i].begin(), places[i].end());
    std::vector<double> parts = wide.loss(more);
    for (std::size_t g = 0; g < parts.size(); ++g) parts[g] = (before[g] - parts[g]) / 2.0 * scale;
    gains[i] = gain_of(parts);
  }
  return gains;
}

}  // namespace bolo::diagnose

// Gauss-Newton iterations, and the gain of effects predicted by the linear model around a fit.
#include "src/diagnose/fit.hpp"

#include "src/diagnose/stages.hpp"

namespace bolo::diagnose {
namespace {

constexpr double kTrustRadius = 8.0;      // largest change of a parameter in one round, in units of its typical size
constexpr double kLargestShift_px = 1.0;  // largest change for moving bars in one round
constexpr double kLargestLateness_s = 0.0005;

// The linear model of all recordings around a state; both vectors are by recording.
struct Linear {
  std::vector<Columns> columns;
  std::vector<std::vector<Group>> groups;
  template <typename Work>
  void for_each_group(const Work& work) const {
    for (const auto& of : groups) std::ranges::for_each(of, work);
  }
};

struct NewtonStep {
  VectorXd by;
  MatrixXd normal;      // with the prior added
  double excess = 1.0;  // ratio of squared residual to noise
};

Linear linearise(const FitData& data, const State& state, const Unknowns& u, const std::vector<Parameter>& parameters) {
  Linear linear;
  linear.columns.resize(data.session.recordings.size());
  linear.groups.resize(data.session.recordings.size());
  for_each_modelled(data.session, data.threads, [&](std::size_t i) {
    Columns& columns = linear.columns[i] = columns_of(data, i, state, u.touching(data.session, i, parameters));
    linear.groups[i] = groups_of(data.session, columns.residual, columns.column, data.fit_pixels);
  });
  return linear;
}

// Solves for steps of the parameters within their bounds, none larger than `most` times its typical size.
VectorXd step_within(const std::vector<const Parameter*>& parameters, const State& state, double most,
                     const MatrixXd& normal, const VectorXd& right) {
  VectorXd low(right.size());
  VectorXd high(right.size());
  for (std::size_t j = 0; j < parameters.size(); ++j) {
    const Parameter& c = *parameters[j];
    const double limit = most * c.step;
    low[static_cast<Index>(j)] = std::max(-limit, std::min(0.0, c.low - c.get(state)));
    high[static_cast<Index>(j)] = std::min(limit, std::max(0.0, c.high - c.get(state)));
  }
  return solve_within(normal, right, low, high);
}

NewtonStep step_of(const Linear& linear, const Unknowns& u, const State& state) {
  const auto count = static_cast<Index>(u.parameters.size());
  MatrixXd normal = MatrixXd::Zero(count, count);
  VectorXd right = VectorXd::Zero(count);
  double squares = 0.0;
  double weights = 1.0;
  linear.for_each_group([&](const Group& g) {
    normal += g.train.topLeftCorner(count, count);
    right += g.train.topRightCorner(count, 1);
    squares += g.train(count, count);
  });
  for (const Columns& columns : linear.columns) {
    weights += static_cast<double>((columns.residual.array() != 0.0F).count()) / 2.0;
  }
  // The prior is scaled for a well-predicted session; in a bad fit it keeps its relative weight.
  NewtonStep step;
  step.excess = std::max(1.0, squares / weights);
  step.normal = normal / step.excess;
  right /= step.excess;
  u.add_prior(state, step.normal, right);
  const auto parameters = mapped(u.parameters, [](const Parameter& p) { return &p; });
  step.by = step_within(parameters, state, kTrustRadius, step.normal, right);
  return step;
}

// Interpolates the shifts of unused frames from their neighbours.
void fill_unseen_shifts(const FitData& data, State& state) {
  for (std::size_t i = 0; i < data.session.recordings.size(); ++i) {
    const Recording& r = data.session.recordings[i];
    if (r.kind != Kind::kMovingBars) continue;
    StimulusState& s = state.stimuli[i];
    const auto seen =
        places_where(r.used.size(), [&](std::size_t k) { return data.frame_counts(i, static_cast<Index>(k)); });
    if (seen.empty()) continue;
    const auto time = [&](std::size_t k) { return r.t[k] + s.late_s[k]; };
    for (std::size_t k = 0; k < r.used.size(); ++k) {
      const auto next = std::ranges::lower_bound(seen, k);
      const std::size_t near = next == seen.end() ? seen.back() : *next;
      if (near != k) s.shift_px[k] = s.shift_px[near] + s.speed_px_s[near] * (time(k) - time(near));
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
    StimulusState& stimulus = state.stimuli[i];
    for (std::size_t k = 0; k < columns.shift.size(); ++k) {
      double shift = columns.shift[k];
      for (std::size_t j = 0; j < columns.turn.size(); ++j) {
        shift -= columns.turn[j][k] * step.by[static_cast<Index>(j)];
      }
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

// Standard errors of the unknowns: from the noise, or from the scatter of the groups if that is larger.
VectorXd errors_of(const Linear& linear, const NewtonStep& step) {
  const Index count = step.by.size();
  const MatrixXd spread = inverse(step.normal);
  MatrixXd outer = MatrixXd::Zero(count, count);
  linear.for_each_group([&](const Group& g) {
    const VectorXd gradient = g.train.topRightCorner(count, 1) - g.train.topLeftCorner(count, count) * step.by;
    outer += gradient * gradient.transpose();
  });
  const MatrixXd robust = spread * (outer / (step.excess * step.excess)) * spread;
  return spread.diagonal().cwiseMax(robust.diagonal()).cwiseMax(0.0).cwiseSqrt();
}

// The candidate's parameters. Setting one also sets the candidate's form, so the base state stays unchanged.
std::vector<Parameter> parameters_of(const Session& session, const Choice& candidate) {
  std::vector<Parameter> all = candidate.effect->parameters(session);
  if (candidate.form == nullptr) return all;
  for (Parameter& c : all) {
    c.set = [set = c.set, begin = candidate.form](State& s, double value) {
      (*begin)(s);
      set(s, value);
    };
  }
  return all;
}

// Training equations of all unknowns, and held-out ones by group.
struct Wide {
  const Unknowns& base;
  const State& state;
  std::vector<Parameter> parameters;  // those of the base, then of the candidates
  MatrixXd normal;                    // augmented
  std::vector<const MatrixXd*> test;  // augmented, of each group

  // Squared residual of each held-out group with the parameters `chosen` fitted.
  std::vector<double> loss(const std::vector<Index>& chosen) const {
    MatrixXd a = normal(chosen, chosen);
    VectorXd b = normal(chosen, normal.cols() - 1);
    base.add_prior(state, a, b);
    const auto wanted = mapped(chosen, [this](Index j) { return &parameters[static_cast<std::size_t>(j)]; });
    const VectorXd x = step_within(wanted, state, std::numeric_limits<double>::infinity(), a, b);
    return mapped(test, [&](const MatrixXd* of) {
      const Index last = of->cols() - 1;
      return (*of)(last, last) - 2.0 * x.dot((*of)(chosen, last)) + x.dot((*of)(chosen, chosen) * x);
    });
  }
};

}  // namespace

MatrixXd least_squares(const MatrixXd& basis, const MatrixXd& values) {
  return basis.colPivHouseholderQr().solve(values);
}

FitResult fit(const FitData& data, const State& start, const std::vector<Choice>& choices, int rounds) {
  FitResult result{start, {}, choices, {}, {}};
  for (const Choice& choice : choices) {
    if (choice.form != nullptr) (*choice.form)(result.state);
  }
  const Unknowns u(data.session, nominal_of(data.session, start), choices);
  const bool maps = std::ranges::any_of(choices, [](const Choice& c) { return c.effect->map != MapKind::kNone; });
  VectorXd errors = VectorXd::Zero(static_cast<Index>(u.parameters.size()));
  for (int round = 0; round < rounds; ++round) {
    const Linear linear = linearise(data, result.state, u, u.parameters);
    const NewtonStep step = step_of(linear, u, result.state);
    take(data, step, linear, u, result.state);
    if (maps) result.state = estimate_maps(data, std::move(result.state), choices);
    if (round + 1 == rounds) errors = errors_of(linear, step);
  }
  for (std::size_t c = 0; c < choices.size(); ++c) {
    auto& values = result.value.emplace_back();
    for (std::size_t j = u.first[c]; j < u.first[c + 1]; ++j) values.push_back(u.parameters[j].get(result.state));
    result.error.emplace_back(errors.begin() + static_cast<Index>(u.first[c]),
                              errors.begin() + static_cast<Index>(u.first[c + 1]));
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
  std::vector<Index> chosen(u.parameters.size());
  std::iota(chosen.begin(), chosen.end(), 0);
  std::vector<std::vector<Index>> with(candidates.size(), chosen);  // the base's and each candidate's parameters
  for (std::size_t i = 0; i < candidates.size(); ++i) {
    for (Parameter& c : parameters_of(data.session, candidates[i])) {
      with[i].push_back(static_cast<Index>(wide.parameters.size()));
      wide.parameters.push_back(std::move(c));
    }
  }
  const Linear linear = linearise(data, base.state, u, wide.parameters);
  const auto size = static_cast<Index>(wide.parameters.size()) + 1;
  wide.normal = MatrixXd::Zero(size, size);
  linear.for_each_group([&wide](const Group& g) {
    wide.normal += g.train;
    wide.test.push_back(&g.test);
  });
  // Scales the gain from the fitted pixels to all pixels.
  const double scale = static_cast<double>(data.all_pixels.size()) / static_cast<double>(data.fit_pixels.size());
  const std::vector<double> before = wide.loss(chosen);
  std::vector<Gain> gains(candidates.size());
  for (std::size_t i = 0; i < candidates.size(); ++i) {
    const Effect& effect = *candidates[i].effect;
    // The drift's map needs its cubics; other maps are tried alone.
    if (effect.map != MapKind::kNone && effect.map != MapKind::kDrift) {
      gains[i] = gain_between(base.score, map_gain(data, base.state, base.score, effect.map));
    } else if (with[i].size() > chosen.size()) {
      std::vector<double> parts = wide.loss(with[i]);
      for (std::size_t g = 0; g < parts.size(); ++g) parts[g] = (before[g] - parts[g]) / 2.0 * scale;
      gains[i] = gain_of(parts);
    }
  }
  return gains;
}

}  // namespace bolo::diagnose

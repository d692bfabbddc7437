// What candidates would gain, by the linear model around a fit: cheap, so that only the best are fitted in earnest.
#include <algorithm>

#include "fit.hpp"

namespace bolo::diagnose {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

// The candidate's coordinates; its form takes effect together with them, so that the base stays as it is.
std::vector<Coordinate> coordinates_of(const Session& session, const Choice& candidate) {
  if (!candidate.effect->coordinates) return {};
  std::vector<Coordinate> all = candidate.effect->coordinates(session);
  if (candidate.form < 0) return all;
  for (Coordinate& c : all) {
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
  std::vector<Coordinate> coordinates;  // the base's, then those of the candidates
  MatrixXd normal;                      // augmented
  std::vector<const MatrixXd*> test;    // augmented, of each group

  // Squared residual of each group when the coordinates `chosen` are solved for.
  std::vector<double> loss(const std::vector<Index>& chosen) const {
    MatrixXd a = normal(chosen, chosen);
    VectorXd b = normal(chosen, normal.cols() - 1);
    base.add_prior(state, a, b);
    const auto size = static_cast<Index>(chosen.size());
    VectorXd low(size);
    VectorXd high(size);
    for (Index r = 0; r < size; ++r) {
      const Coordinate& c = coordinates[static_cast<std::size_t>(chosen[static_cast<std::size_t>(r)])];
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

std::vector<Gain> Fitter::screen(const FitResult& base, const std::vector<Choice>& candidates) const {
  const Unknowns u(session_, nominal_of(session_, base.state), base.choices);
  Wide wide{u, base.state, u.coordinates, {}, {}};
  std::vector<std::vector<Index>> places;  // of each candidate's coordinates
  for (const Choice& candidate : candidates) {
    auto& own = places.emplace_back();
    for (Coordinate& c : coordinates_of(session_, candidate)) {
      own.push_back(static_cast<Index>(wide.coordinates.size()));
      wide.coordinates.push_back(std::move(c));
    }
  }
  const Linear linear = linearise(base.state, u, wide.coordinates);
  const auto size = static_cast<Index>(wide.coordinates.size()) + 1;
  wide.normal = MatrixXd::Zero(size, size);
  for (const auto& of : linear.groups) {
    for (const Group& g : of) {
      wide.normal += g.train;
      wide.test.push_back(&g.test);
    }
  }
  // The fit's pixels stand for all.
  const double scale = static_cast<double>(all_pixels_.size()) / static_cast<double>(fit_pixels_.size());
  std::vector<Index> chosen;
  for (std::size_t j = 0; j < u.coordinates.size(); ++j) chosen.push_back(static_cast<Index>(j));
  const std::vector<double> before = wide.loss(chosen);
  std::vector<Gain> gains(candidates.size());
  for (std::size_t i = 0; i < candidates.size(); ++i) {
    if (candidates[i].effect->map != MapKind::kNone && !candidates[i].effect->coordinates) {
      gains[i] = gain_between(base.score, map_gain(base, candidates[i].effect->map));
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

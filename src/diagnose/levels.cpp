// Fitted levels compared with the stated accuracy of the bench.
#include "src/diagnose/fit.hpp"

namespace bolo::diagnose {
namespace {

// Mean square of the levels' errors, each divided by unit_of(level).
template <typename UnitOf>
double mean_of_levels(const std::vector<Nuisance>& all, const State& state, const UnitOf& unit_of) {
  double sum = 0.0;
  double count = 0.0;
  for (const Nuisance& n : all) {
    if (!n.is_level) continue;
    const double error = (n.parameter.get(state) - n.nominal) / unit_of(n);
    sum += error * error;
    count += 1.0;
  }
  return sum / std::max(1.0, count);
}

// Levels of the same stated temperature and accuracy: a black body set to it in several captures.
struct SetPoint {
  double nominal = 0.0;
  double prior = 0.0;
  double count = 0.0;
  double mean = 0.0;   // of the errors, K
  double about = 0.0;  // sum of squares about that mean
};

std::vector<SetPoint> set_points(const std::vector<Nuisance>& all, const State& state) {
  constexpr double kSame_k = 1e-3;
  std::vector<SetPoint> points;
  for (const Nuisance& n : all) {
    if (!n.is_level) continue;
    auto point = std::ranges::find_if(points, [&n](const SetPoint& p) {
      return std::abs(p.nominal - n.nominal) < kSame_k && std::abs(p.prior - n.prior) < kSame_k;
    });
    if (point == points.end()) point = points.insert(points.end(), {n.nominal, n.prior});
    const double apart = n.parameter.get(state) - n.nominal - point->mean;
    point->count += 1.0;
    point->mean += apart / point->count;
    point->about += apart * apart * (point->count - 1.0) / point->count;
  }
  return points;
}

// The part of the spread that differs between levels of one set point, as a share of the stated accuracy: all of it if
// each capture has its own error, none if a set point has the same error in all captures.
double own_spread(const std::vector<SetPoint>& points, double spread) {
  double squares = 0.0;
  double freedom = 0.0;
  for (const SetPoint& p : points) {
    if (p.prior > 0.0) squares += p.about / (p.prior * p.prior);
    freedom += p.count - 1.0;
  }
  return freedom > 0.0 ? std::min(spread, std::sqrt(squares / freedom)) : spread;
}

}  // namespace

double level_spread(const std::vector<Nuisance>& all, const State& state) {
  return std::sqrt(std::min(1.0, mean_of_levels(all, state, [](const Nuisance& n) { return n.prior; })));
}

double level_error(const std::vector<Nuisance>& all, const State& state) {
  return std::sqrt(mean_of_levels(all, state, [](const Nuisance&) { return 1.0; }));
}

double level_evidence(const std::vector<Nuisance>& all, const State& state) {
  const double spread = level_spread(all, state);
  const std::vector<SetPoint> points = set_points(all, state);
  const double own = own_spread(points, spread);
  double evidence = 0.0;
  for (const SetPoint& point : points) {
    const double one = std::pow(kLevelResolution, 2) + std::pow(own * point.prior, 2);
    const double common = one + point.count * (spread * spread - own * own) * point.prior * point.prior;
    evidence -=
        0.5 * (std::log(common) + (point.count - 1.0) * std::log(one)) - point.count * std::log(kLevelResolution);
    evidence -= 0.5 * (point.count * point.mean * point.mean / common + point.about / one);
  }
  return evidence;
}

double independent_levels(const std::vector<Nuisance>& all, const State& state) {
  const double spread = level_spread(all, state);
  const std::vector<SetPoint> points = set_points(all, state);
  const double own = spread > 0.0 ? own_spread(points, spread) / spread : 1.0;
  return sum_of(points, [own](const SetPoint& p) { return 1.0 + (p.count - 1.0) * own * own; });
}

double level_excess(const std::vector<Nuisance>& all, const State& state) {
  constexpr double kResolved_k = 0.05;  // error of a level due to the camera's own offsets
  const std::vector<SetPoint> points = set_points(all, state);
  const double squares =
      sum_of(points, [](const SetPoint& p) { return std::pow(p.mean / std::hypot(p.prior, kResolved_k), 2); });
  return std::sqrt(squares / std::max(1.0, static_cast<double>(points.size())));
}

}  // namespace bolo::diagnose

// Cuts a signal into intervals and fits their common tau.
#include "src/core/statistics.hpp"
#include "src/diagnose/calibrate/pulses.hpp"

namespace bolo::diagnose {
namespace {

constexpr std::size_t kLongest = 160;  // samples of an interval in the search; longer ones are joined afterwards
constexpr double kTauRatio = 1.12;     // between two trial taus
constexpr double kShortestTau = 0.3;   // in frame periods
constexpr double kLongestTau = 60.0;

// Line of y over e = exp(-(t - t_first) / tau). With too little scatter in e, only the mean is fitted.
constexpr double kLeastScatter = 1e-12;

double slope_of(const Line& line) {
  return line.scatter_x() > kLeastScatter ? line.scatter_xy() / line.scatter_x() : 0.0;
}

double squares_left(const Line& line) {
  const double xy = line.scatter_xy();
  const double explained = line.scatter_x() > kLeastScatter ? xy * xy / line.scatter_x() : 0.0;
  return std::max(0.0, line.scatter_y() - explained);
}

struct Cut {
  std::vector<Interval> intervals;
  double cost = 0.0;
};

Cut best_cut(std::span<const double> t_s, std::span<const double> y, double tau_s, double sigma) {
  const std::size_t n = y.size();
  const double unit = 1.0 / (sigma * sigma);
  std::vector<double> decay(n, 1.0);  // from the sample before
  for (std::size_t k = 1; k < n; ++k) decay[k] = std::exp(-(t_s[k] - t_s[k - 1]) / tau_s);
  std::vector<double> best(n + 1, std::numeric_limits<double>::infinity());
  std::vector<std::size_t> from(n + 1, 0);
  best[0] = 0.0;
  for (std::size_t first = 0; first < n; ++first) {
    Line line;
    double e = 1.0;
    for (std::size_t k = first; k < std::min(n, first + kLongest); ++k) {
      if (k > first) e *= decay[k];
      line.add(e, y[k] - y[first]);
      const double squares = squares_left(line) * unit;
      const double cost = best[first] + squares + kIntervalCost;
      if (cost < best[k + 1]) {
        best[k + 1] = cost;
        from[k + 1] = first;
      }
      if (squares > 40.0 * kIntervalCost) break;  // any longer interval costs more than a cut
    }
  }
  Cut found{{}, best[n]};
  for (std::size_t end = n; end > 0; end = from[end]) found.intervals.push_back({from[end], end - from[end]});
  std::ranges::reverse(found.intervals);
  return found;
}

// Joins neighbours that one curve fits equally well.
std::vector<Interval> joined(std::span<const double> t_s, std::span<const double> y,
                             const std::vector<Interval>& intervals, double tau_s, double sigma) {
  const auto squares = [&](const Interval& interval) {
    double left = 0.0;
    fit_decay(t_s, y, interval, tau_s, &left);
    return left;
  };
  std::vector<Interval> out;
  for (const Interval& next : intervals) {
    if (!out.empty() && out.back().count > 2 && next.count > 2) {
      const Interval both{out.back().first, out.back().count + next.count};
      if (squares(both) - squares(out.back()) - squares(next) < kIntervalCost * sigma * sigma) {
        out.back() = both;
        continue;
      }
    }
    out.push_back(next);
  }
  return out;
}

struct IntervalScore {
  double score = 0.0;
  double information = 0.0;
  double squares = 0.0;
};

IntervalScore score_of(std::span<const double> t_s, std::span<const double> y, const Interval& interval, double tau_s) {
  const Regressors x(t_s, interval, tau_s);
  const auto values = y.subspan(interval.first, interval.count);
  IntervalSums s{.base = values.front()};
  for (std::size_t k = 0; k < values.size(); ++k) s.add(x, k, values[k]);
  const double amplitude = s.amplitude(x);
  return {amplitude * s.uy, amplitude * amplitude * x.uu, s.squares(x)};
}

}  // namespace

Regressors::Regressors(std::span<const double> t_s, const Interval& interval, double tau_s)
    : e(interval.count), u(interval.count) {
  const auto n = static_cast<double>(interval.count);
  for (std::size_t k = 0; k < interval.count; ++k) {
    const double age = (t_s[interval.first + k] - t_s[interval.first]) / tau_s;
    e[k] = std::exp(-age);
    u[k] = age * e[k];
    e_mean += e[k] / n;
  }
  const double u_mean = sum_of(u, [n](double v) { return v / n; });
  double eu = 0.0;
  for (std::size_t k = 0; k < interval.count; ++k) {
    e[k] -= e_mean;
    u[k] -= u_mean;
    ee += e[k] * e[k];
    eu += e[k] * u[k];
  }
  for (std::size_t k = 0; k < interval.count; ++k) u[k] -= eu / ee * e[k];
  uu = sum_of(u, [](double v) { return v * v; });
}

double freedom_of(const std::vector<Interval>& intervals) {
  double freedom = -1.0;
  for (const Interval& interval : intervals) {
    if (interval.count >= kLeastCount) freedom += static_cast<double>(interval.count) - 2.0;
  }
  return freedom;
}

std::vector<double> gaps_of(std::span<const double> t_s) {
  std::vector<double> gaps;
  for (std::size_t k = 1; k < t_s.size(); ++k) gaps.push_back(t_s[k] - t_s[k - 1]);
  return gaps;
}

double Decay::at(double t_s, double tau_s) const { return level + amplitude * std::exp(-(t_s - t_first_s) / tau_s); }

std::vector<Interval> cut(std::span<const double> t_s, std::span<const double> y, double tau_s, double sigma) {
  return joined(t_s, y, best_cut(t_s, y, tau_s, sigma).intervals, tau_s, sigma);
}

Decay fit_decay(std::span<const double> t_s, std::span<const double> y, const Interval& interval, double tau_s,
                double* squares) {
  Line line;
  const double start_s = t_s[interval.first];
  const double base = y[interval.first];
  for (std::size_t k = interval.first; k < interval.end(); ++k) {
    line.add(std::exp(-(t_s[k] - start_s) / tau_s), y[k] - base);
  }
  if (squares != nullptr) *squares = squares_left(line);
  const double amplitude = interval.count > 1 ? slope_of(line) : 0.0;
  return {base + line.level(amplitude), amplitude, start_s};
}

void refit(std::span<const double> t_s, std::span<const double> y, SignalFit& fit) {
  std::vector<Interval> telling = fit.intervals;
  std::erase_if(telling, [](const Interval& interval) { return interval.count < kLeastCount; });
  std::vector<IntervalScore> scores;
  for (int round = 0; round < 30; ++round) {
    scores = mapped(telling, [&](const Interval& interval) { return score_of(t_s, y, interval, fit.tau_s); });
    fit.information = sum_of(scores, &IntervalScore::information);
    if (!(fit.information > 0.0)) break;
    const double step = std::clamp(sum_of(scores, &IntervalScore::score) / fit.information, -0.2, 0.2);
    fit.tau_s *= std::exp(step);
    if (std::abs(step) < 1e-10) break;
  }
  const double freedom = freedom_of(telling);
  fit.informative_samples = 0;
  for (const Interval& interval : telling) fit.informative_samples += interval.count;
  const double sandwich = sum_of(scores, [](const IntervalScore& s) { return s.score * s.score; });
  const double information2 = sum_of(scores, [](const IntervalScore& s) { return s.information * s.information; });
  fit.sigma = freedom > 0.0 ? std::sqrt(sum_of(scores, &IntervalScore::squares) / freedom) : 0.0;
  const double m = information2 > 0.0 ? fit.information * fit.information / information2 : 0.0;
  fit.effective_intervals = m;
  // m / (m - 1) corrects for the fitted parameter, which makes the scores sum to zero.
  fit.interval_variance = m > 1.05 ? sandwich / (fit.information * fit.information) * m / (m - 1.0) : 0.0;
  fit.decays = mapped(fit.intervals, [&](const Interval& i) { return fit_decay(t_s, y, i, fit.tau_s); });
}

std::optional<SignalFit> fit_signal(std::span<const double> t_s, std::span<const double> y) {
  SignalFit fit;
  const std::vector<double> values(y.begin(), y.end());
  fit.contrast = quantile(values, 0.95) - quantile(values, 0.05);
  if (!(fit.contrast > 0.0)) return std::nullopt;
  const double period_s = quantile(gaps_of(t_s), 0.5);
  // A coarse search first: noise and model errors, still unknown, are assumed to be about 1 % of the contrast.
  std::vector<double> rough;  // noise by third differences, too large where the signal decays
  for (std::size_t k = 3; k < y.size(); ++k) {
    rough.push_back(std::abs(y[k] - 3.0 * y[k - 1] + 3.0 * y[k - 2] - y[k - 3]));
  }
  double sigma = std::max(0.005 * fit.contrast, 0.3 * quantile(rough, 0.5) / (kMadOfSigma * std::sqrt(20.0)));
  double least = std::numeric_limits<double>::infinity();
  for (double tau_s = kShortestTau * period_s; tau_s < kLongestTau * period_s; tau_s *= kTauRatio) {
    const Cut found = best_cut(t_s, y, tau_s, sigma);
    if (found.cost < least) {
      least = found.cost;
      fit.tau_s = tau_s;
    }
  }
  fit.intervals = cut(t_s, y, fit.tau_s, sigma);
  refit(t_s, y, fit);
  for (int round = 0; round < 4; ++round) {
    // Only constant levels or only slopes: no tau, but the cut may still be of use.
    if (!(fit.information > 0.0) || !(fit.tau_s > 0.05 * period_s && fit.tau_s < 200.0 * period_s)) {
      fit.information = 0.0;
      break;
    }
    sigma = std::max(std::min(fit.sigma, sigma), 1e-5 * fit.contrast);
    const auto before = fit.intervals.size();
    fit.intervals = cut(t_s, y, fit.tau_s, sigma);
    refit(t_s, y, fit);
    if (before == fit.intervals.size() && round > 0) break;
  }
  return fit;
}

std::optional<double> crossing(const Decay& before, const Decay& after, double tau_s, double from_s, double to_s) {
  // Both curves are a level plus a multiple of the same exponential, so their intersection has a closed form.
  const double shift = std::exp(-(after.t_first_s - before.t_first_s) / tau_s);  // exp at t_first of `after`
  const double amplitude = before.amplitude * shift - after.amplitude;           // relative to after.t_first_s
  const double level = after.level - before.level;
  const double ratio = level / amplitude;
  if (!(ratio > 0.0) || !std::isfinite(ratio)) return std::nullopt;
  const double t_s = after.t_first_s - tau_s * std::log(ratio);
  if (!(t_s >= from_s && t_s <= to_s)) return std::nullopt;
  return t_s;
}

}  // namespace bolo::diagnose

#include "pulse_sweep.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

#include <Eigen/Dense>

#include "statistics.hpp"

namespace bolo::diagnose {

Sweep fit_sweep(const FrameSeries& frames, const PixelTaus& taus, double tau_s) {
  Sweep sweep;
  const auto width = static_cast<std::size_t>(frames.geometry.width);
  const double across = frames.geometry.width;
  const double down = frames.geometry.height;
  double scatter = std::numeric_limits<double>::infinity();
  for (int round = 0; round < 3; ++round) {  // what is far off, such as an edge taken for its neighbour, goes
    Eigen::Matrix3d normal = Eigen::Matrix3d::Identity() * 1e-12;
    Eigen::Vector3d right = Eigen::Vector3d::Zero();
    std::vector<double> squares;
    const auto place = [&](std::size_t p) {
      const std::size_t row = p / width;
      return Eigen::Vector3d(1.0, (static_cast<double>(p % width) + 0.5) / across - 0.5,
                             (static_cast<double>(row) + 0.5) / down - 0.5);
    };
    const auto left = [&](std::size_t p) { return static_cast<double>(taus.delay_s[p]) - place(p).dot(sweep.delay); };
    for (std::size_t p = 0; p < taus.delay_s.size(); ++p) {
      if (!(taus.delay_weight[p] > 0.0F) || std::abs(left(p)) > 4.0 * scatter) continue;
      normal += place(p) * place(p).transpose();
      right += place(p) * static_cast<double>(taus.delay_s[p]);
    }
    sweep.delay = normal.ldlt().solve(right);
    for (std::size_t p = 0; p < taus.delay_s.size(); ++p) {
      if (taus.delay_weight[p] > 0.0F) squares.push_back(std::abs(left(p)));
    }
    scatter = std::max(1e-9 * tau_s, median(std::move(squares)) / 0.6745);
    sweep.error = scatter * normal.inverse().diagonal().array().sqrt();
  }
  return sweep;
}

std::vector<SwitchBetween> between(const FrameSeries& frames, const DecayTable& table, const SignalFit& fit,
                                   double reach_s) {
  std::vector<SwitchBetween> switches;
  for (std::size_t i = 0; i + 1 < table.intervals().size(); ++i) {
    const Interval& a = table.intervals()[i];
    const Interval& b = table.intervals()[i + 1];
    const auto decay = [&](const Interval& interval) {
      const auto at = std::ranges::find(fit.intervals, interval.first, &Interval::first) - fit.intervals.begin();
      return fit.decays[static_cast<std::size_t>(at)];
    };
    const double from_s = frames.t_s[a.end() - 1] - reach_s;
    const double to_s = frames.t_s[b.first] + reach_s;
    if (const auto t_s = crossing(decay(a), decay(b), fit.tau_s, from_s, to_s)) {
      switches.push_back({i, *t_s, from_s, to_s});
    }
  }
  return switches;
}

void trim(const FrameSeries& frames, const std::vector<SwitchBetween>& switches, const DecayTable& table,
          const Sweep& sweep, SignalFit& fit) {
  const double margin_s = 1e-4 + 0.05 * (sweep.high() - sweep.low());
  for (const SwitchBetween& at : switches) {
    const double from_s = at.t_s + sweep.low() - margin_s;
    const double to_s = at.t_s + sweep.high() + margin_s;
    for (Interval& interval : fit.intervals) {
      if (interval.first == table.intervals()[at.before].first) {
        while (interval.count > 1 && frames.t_s[interval.end() - 1] > from_s) --interval.count;
      }
      if (interval.first == table.intervals()[at.before + 1].first) {
        while (interval.count > 1 && frames.t_s[interval.first] < to_s) {
          ++interval.first;
          --interval.count;
        }
        break;
      }
    }
  }
}

Estimate sweep_estimate(const Sweep& sweep, int axis) {
  return {sweep.delay[axis], sweep.delay[axis] - 1.96 * sweep.error[axis],
          sweep.delay[axis] + 1.96 * sweep.error[axis]};
}

}  // namespace bolo::diagnose

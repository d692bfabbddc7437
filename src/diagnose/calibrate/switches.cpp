// Switching times of the input: their sweep over the frame, and those of the mean signal and of one pixel.
#include "src/diagnose/calibrate/pulses.hpp"
#include "src/diagnose/session.hpp"

namespace bolo::diagnose {
namespace {

constexpr double kFarDelay = 4.0;         // outlier limit, in scatters: a switch mistaken for its neighbour
constexpr double kSwitchMargin_s = 1e-4;  // smallest distance of a sample from a switch, beyond the sweep, plus
constexpr double kSweepMargin = 0.05;     // this share of the sweep

constexpr double kNone = std::numeric_limits<double>::quiet_NaN();

struct Piece {
  Decay decay;
  std::size_t count = 0;
  double to_s = 0.0;
  bool goes_on = false;  // the next piece has the same input
};

constexpr double kSameLevel = 0.01;  // of the contrast: a smaller change is no switch
constexpr std::size_t kTiny = 2;     // most samples during a switch

// Intersection of two curves between the last sample of one interval and the first sample of the other.
std::optional<double> meet(std::span<const double> t_s, const Interval& a, const Interval& b, const Decay& before,
                           const Decay& after, double tau_s) {
  const double from_s = t_s[a.end() - 1];
  const double to_s = t_s[b.first];
  const double slack_s = 0.1 * (to_s - from_s);
  return crossing(before, after, tau_s, from_s - slack_s, to_s + slack_s);
}

// The consecutive curves. One or two samples between curves that intersect belong to the switch; otherwise they are a
// pulse too short to fit. A curve that continues at the same level is not counted as new.
std::vector<Piece> pieces_of(std::span<const double> t_s, const std::vector<Interval>& intervals,
                             const std::vector<Decay>& decays, double tau_s, double contrast) {
  std::vector<Piece> pieces;
  std::size_t last = 0;
  for (std::size_t i = 0; i < intervals.size(); ++i) {
    const bool tiny = intervals[i].count <= kTiny;
    if (tiny && !pieces.empty() && i + 1 < intervals.size() &&
        meet(t_s, intervals[last], intervals[i + 1], decays[last], decays[i + 1], tau_s)) {
      continue;
    }
    if (!pieces.empty()) {
      if (!tiny && std::abs(decays[i].level - decays[last].level) < kSameLevel * contrast &&
          intervals[last].count > 2 && intervals[i].first == intervals[last].end()) {
        pieces.back().to_s = (t_s[intervals[last].end() - 1] + t_s[intervals[i].first]) / 2.0;
        pieces.back().goes_on = true;
      } else {
        const auto met = meet(t_s, intervals[last], intervals[i], decays[last], decays[i], tau_s);
        pieces.back().to_s = met.value_or((t_s[intervals[last].end() - 1] + t_s[intervals[i].first]) / 2.0);
      }
    }
    pieces.push_back({decays[i], intervals[i].count, t_s.back(), false});
    last = i;
  }
  return pieces;
}

// The pixel nearest to the middle of the frame among those whose error of tau is at most the median.
std::size_t middle_pixel(const FrameSeries& frames, const PixelTaus& taus, const std::vector<std::size_t>& pixels) {
  const float usual = median(mapped(pixels, [&](std::size_t p) { return taus.error[p]; }));
  std::size_t chosen = pixels.front();
  double nearest = std::numeric_limits<double>::infinity();
  for (const std::size_t p : pixels) {
    const PixelPlace at = place_of(p, frames.geometry.width);
    const double x = at.x - frames.geometry.width / 2.0;
    const double y = at.y - frames.geometry.height / 2.0;
    if (!(taus.error[p] <= usual) || !(x * x + y * y < nearest)) continue;
    nearest = x * x + y * y;
    chosen = p;
  }
  return chosen;
}

}  // namespace

Sweep fit_sweep(const FrameSeries& frames, const PixelTaus& taus, double tau_s) {
  Sweep sweep;
  const auto pixels = places_where(taus.delay_s.size(), [&](std::size_t p) { return std::isfinite(taus.delay_s[p]); });
  const auto place = [&](std::size_t p) {
    const PixelPlace at = place_of(p, frames.geometry.width);
    return Eigen::Vector3d(1.0, (at.x + 0.5) / frames.geometry.width - 0.5,
                           (at.y + 0.5) / frames.geometry.height - 0.5);
  };
  const auto left = [&](std::size_t p) { return taus.delay_s[p] - place(p).dot(sweep.delay); };
  double scatter = std::numeric_limits<double>::infinity();
  for (int round = 0; round < 3; ++round) {  // excludes outliers, such as a switch mistaken for its neighbour
    Eigen::Matrix3d normal = Eigen::Matrix3d::Identity() * 1e-12;
    Eigen::Vector3d right = Eigen::Vector3d::Zero();
    for (const std::size_t p : pixels) {
      if (std::abs(left(p)) > kFarDelay * scatter) continue;
      normal += place(p) * place(p).transpose();
      right += place(p) * static_cast<double>(taus.delay_s[p]);
    }
    sweep.delay = normal.ldlt().solve(right);
    const double typical = median(mapped(pixels, [&](std::size_t p) { return std::abs(left(p)); }));
    scatter = std::max(1e-9 * tau_s, typical / kMadOfSigma);
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
  const double margin_s = kSwitchMargin_s + kSweepMargin * (sweep.high() - sweep.low());
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

void describe_switches(std::span<const double> t_s, const SignalFit& signal, PulseFit& fit) {
  const std::vector<Piece> pieces = pieces_of(t_s, signal.intervals, signal.decays, signal.tau_s, signal.contrast);
  for (std::size_t i = 0; i < pieces.size(); ++i) {
    if (pieces[i].goes_on) continue;
    fit.levels_k.push_back(pieces[i].count >= 3 ? pieces[i].decay.level : kNone);
    if (i + 1 < pieces.size()) fit.switches_s.push_back(pieces[i].to_s - t_s.front());
  }
}

Status show_pixel(const FrameSeries& frames, const SignalFit& signal, const PixelTaus& taus,
                  const std::vector<std::size_t>& pixels, PixelTrace& trace) {
  if (pixels.empty()) return {};
  const std::size_t chosen = middle_pixel(frames, taus, pixels);
  const PixelPlace at = place_of(chosen, frames.geometry.width);
  trace.x = at.x;
  trace.y = at.y;
  trace.tau_s = taus.tau_s[chosen];
  std::vector<float> frame(frames.geometry.pixels());
  for (std::size_t k = 0; k < frames.t_s.size(); ++k) {
    RETURN_IF_ERROR(frames.read(k, frame));
    trace.measured_k.push_back(frame[chosen]);
    trace.t_s.push_back(frames.t_s[k] - frames.t_s.front());
  }
  const std::vector<Decay> decays = mapped(
      signal.intervals, [&](const Interval& i) { return fit_decay(trace.t_s, trace.measured_k, i, trace.tau_s); });
  const std::vector<Piece> pieces = pieces_of(trace.t_s, signal.intervals, decays, trace.tau_s, signal.contrast);
  const auto simulated = [&](double t_s) {
    const auto piece = std::ranges::find_if(pieces, [t_s](const Piece& p) { return t_s <= p.to_s; });
    return piece == pieces.end() ? kNone : piece->decay.at(t_s, trace.tau_s);
  };
  // Samples outside the intervals, or in intervals without degrees of freedom, are not compared.
  trace.simulated_k.assign(trace.t_s.size(), kNone);
  for (const Interval& i : signal.intervals) {
    if (i.count < kLeastCount) continue;
    for (std::size_t k = i.first; k < i.end(); ++k) trace.simulated_k[k] = simulated(trace.t_s[k]);
  }
  constexpr int kFine = 10;
  for (std::size_t k = 0; k + 1 < trace.t_s.size(); ++k) {
    for (int i = 0; i < kFine; ++i) {
      trace.fine_t_s.push_back(std::lerp(trace.t_s[k], trace.t_s[k + 1], static_cast<double>(i) / kFine));
      trace.fine_k.push_back(simulated(trace.fine_t_s.back()));
    }
  }
  return {};
}

}  // namespace bolo::diagnose

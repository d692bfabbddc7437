#include "pulse_trace.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>

namespace bolo::diagnose {
namespace {

constexpr double kNone = std::numeric_limits<double>::quiet_NaN();

// One of the curves that follow one another, and until when it holds.
struct Piece {
  Decay decay;
  std::size_t count = 0;
  double to_s = 0.0;
  bool goes_on = false;  // the next one is the same input
};

constexpr double kSameLevel = 0.01;  // of the contrast: no switch
constexpr std::size_t kTiny = 2;     // samples that may have been taken while the input changed

// Where two curves meet between the last sample of one interval and the first of another.
std::optional<double> meet(std::span<const double> t_s, const Interval& a, const Interval& b, const Decay& before,
                           const Decay& after, double tau_s) {
  const double from_s = t_s[a.end() - 1];
  const double to_s = t_s[b.first];
  const double slack_s = 0.1 * (to_s - from_s);
  return crossing(before, after, tau_s, from_s - slack_s, to_s + slack_s);
}

// The curves that follow one another. One or two samples between curves that meet were taken while the input changed; a
// lone sample between curves that don't is a pulse too short to say more about. A curve that goes on at the same level
// is no new one.
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

}  // namespace

void describe_switches(std::span<const double> t_s, const SignalFit& signal, PulseFit& fit) {
  fit.switches_s.clear();
  fit.levels_k.clear();
  const std::vector<Piece> pieces = pieces_of(t_s, signal.intervals, signal.decays, signal.tau_s, signal.contrast);
  for (std::size_t i = 0; i < pieces.size(); ++i) {
    if (pieces[i].goes_on) continue;
    fit.levels_k.push_back(pieces[i].count >= 3 ? pieces[i].decay.level : kNone);
    if (i + 1 < pieces.size()) fit.switches_s.push_back(pieces[i].to_s - t_s.front());
  }
}

Result<PixelTrace> trace_pixel(const FrameSeries& frames, const SignalFit& signal, const PixelTaus& taus,
                               const std::vector<std::size_t>& pixels) {
  PixelTrace trace;
  if (pixels.empty()) return trace;
  const int width = frames.geometry.width;
  const auto distance = [&](std::size_t p) {
    const std::size_t row = p / static_cast<std::size_t>(width);
    const double x = static_cast<double>(p % static_cast<std::size_t>(width)) - width / 2.0;
    const double y = static_cast<double>(row) - frames.geometry.height / 2.0;
    return x * x + y * y;
  };
  std::vector<float> errors;
  errors.reserve(pixels.size());
  for (const std::size_t p : pixels) errors.push_back(taus.error[p]);
  std::ranges::nth_element(errors, errors.begin() + static_cast<std::ptrdiff_t>(errors.size() / 2));
  const float usual = errors[errors.size() / 2];
  std::size_t chosen = pixels.front();
  double nearest = std::numeric_limits<double>::infinity();
  for (const std::size_t p : pixels) {
    if (taus.error[p] <= usual && distance(p) < nearest) {
      nearest = distance(p);
      chosen = p;
    }
  }
  trace.x = static_cast<int>(chosen % static_cast<std::size_t>(width));
  trace.y = static_cast<int>(chosen / static_cast<std::size_t>(width));
  trace.tau_s = static_cast<double>(taus.tau_s[chosen]);

  std::vector<float> frame(frames.geometry.pixels());
  for (std::size_t k = 0; k < frames.t_s.size(); ++k) {
    if (Status read = frames.read(k, frame); !read) return tl::unexpected(read.error());
    trace.measured_k.push_back(static_cast<double>(frame[chosen]));
    trace.t_s.push_back(frames.t_s[k] - frames.t_s.front());
  }
  std::vector<Decay> decays;
  for (const Interval& interval : signal.intervals) {
    decays.push_back(fit_decay(trace.t_s, trace.measured_k, interval, trace.tau_s));
  }
  const std::vector<Piece> pieces = pieces_of(trace.t_s, signal.intervals, decays, trace.tau_s, signal.contrast);
  const auto simulated = [&](double t_s) {
    const auto at = std::ranges::find_if(pieces, [t_s](const Piece& piece) { return t_s <= piece.to_s; });
    return at == pieces.end() ? kNone : at->decay.at(t_s, trace.tau_s);
  };
  // Samples of no interval, or of one that has none to spare, are not compared.
  trace.simulated_k.assign(trace.t_s.size(), kNone);
  for (const Interval& interval : signal.intervals) {
    if (interval.count < kLeastCount) continue;
    for (std::size_t k = interval.first; k < interval.end(); ++k) trace.simulated_k[k] = simulated(trace.t_s[k]);
  }
  constexpr int kFine = 10;
  for (std::size_t k = 0; k + 1 < trace.t_s.size(); ++k) {
    for (int i = 0; i < kFine; ++i) {
      trace.fine_t_s.push_back(std::lerp(trace.t_s[k], trace.t_s[k + 1], static_cast<double>(i) / kFine));
      trace.fine_k.push_back(simulated(trace.fine_t_s.back()));
    }
  }
  return trace;
}

}  // namespace bolo::diagnose

// Cuts one signal into intervals in which it is L + A exp(-t / tau), and fits what they have in common: tau.
#pragma once

#include <cstddef>
#include <optional>
#include <span>
#include <vector>

namespace bolo::diagnose {

// Samples [first, first + count) between two switches.
struct Interval {
  std::size_t first = 0;
  std::size_t count = 0;
  std::size_t end() const { return first + count; }
};

// The curve of one interval: level + amplitude * exp(-(t - t_first_s) / tau).
struct Decay {
  double level = 0.0;
  double amplitude = 0.0;
  double t_first_s = 0.0;
  double at(double t_s, double tau_s) const;
};

// The least number of samples that say something about tau.
inline constexpr std::size_t kLeastCount = 4;

// The best cut for a known tau, by dynamic programming: an interval more must pay kIntervalCost in squared residuals
// over sigma^2. A sample that is taken while the input changes ends up in an interval of its own. Thread: any.
std::vector<Interval> cut(std::span<const double> t_s, std::span<const double> y, double tau_s, double sigma);

inline constexpr double kIntervalCost = 25.0;

// Least squares in one interval. One sample: the level alone. `squares`, when asked for, gets the residual's sum.
Decay fit_decay(std::span<const double> t_s, std::span<const double> y, const Interval& interval, double tau_s,
                double* squares = nullptr);

struct SignalFit {
  double tau_s = 0.0;
  double sigma = 0.0;              // rms of the residual, corrected for the fit's freedom
  double information = 0.0;        // of ln tau, in units of 1 / y^2: the variance of ln tau is sigma^2 / information
  double interval_variance = 0.0;  // of ln tau, from how much the intervals differ (a sandwich)
  double effective_intervals = 0.0;
  std::vector<Interval> intervals;  // all, in order
  std::vector<Decay> decays;        // of each
  double contrast = 0.0;            // between the 5th and the 95th percentile of the signal
  std::size_t informative_samples = 0;
};

// Cut and tau of a signal of which neither is known. Nothing when no tau makes sense of it. Thread: any.
std::optional<SignalFit> fit_signal(std::span<const double> t_s, std::span<const double> y);

// tau, and what is known of it, with the cut held fixed, by Gauss and Newton (variable projection). Thread: any.
void refit(std::span<const double> t_s, std::span<const double> y, SignalFit& fit);

// When the input switched between two curves that follow one another: where they meet, in [from_s, to_s]. Nothing when
// they don't. Thread: any.
std::optional<double> crossing(const Decay& before, const Decay& after, double tau_s, double from_s, double to_s);

}  // namespace bolo::diagnose

// Steps of the fit of tau to pulses: cutting a signal into intervals, the pixels' common signal, each pixel's fit, the
// sweep of the switches, and the switches and the trace for the report.
#pragma once

#include <Eigen/Core>

#include "src/diagnose/calibrate.hpp"

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

// Fewest samples from which tau can be estimated.
inline constexpr std::size_t kLeastCount = 4;

// Degrees of freedom: samples of the intervals used for tau, less two (level, amplitude) per interval and one for tau.
double freedom_of(const std::vector<Interval>& intervals);

// Times between consecutive frames, s.
std::vector<double> gaps_of(std::span<const double> t_s);

// Regressors of an interval and tau: e = exp(-t / tau) less its mean; u: derivative by ln tau, orthogonal to 1 and e.
struct Regressors {
  Regressors(std::span<const double> t_s, const Interval& interval, double tau_s);
  std::vector<double> e;
  std::vector<double> u;
  double e_mean = 0.0;  // of exp(-t / tau)
  double ee = 0.0;      // sum of e^2
  double uu = 0.0;      // sum of u^2
};

// Sums of one interval's values, relative to the first one, with its regressors.
struct IntervalSums {
  double base = 0.0;
  double y = 0.0, yy = 0.0, ey = 0.0, uy = 0.0;
  void add(const Regressors& x, std::size_t k, double value) {
    const double off = value - base;
    y += off;
    yy += off * off;
    ey += x.e[k] * off;
    uy += x.u[k] * off;
  }
  double amplitude(const Regressors& x) const { return ey / x.ee; }
  // Sum of squared residuals.
  double squares(const Regressors& x) const {
    return std::max(0.0, yy - y * y / static_cast<double>(x.e.size()) - ey * ey / x.ee);
  }
};

// The best cut for a known tau, by dynamic programming: each interval costs kIntervalCost in units of squared residual
// / sigma^2. A sample taken while the input changes gets an interval of its own. Thread: any.
std::vector<Interval> cut(std::span<const double> t_s, std::span<const double> y, double tau_s, double sigma);

inline constexpr double kIntervalCost = 25.0;

// Least squares in one interval; of one sample, the level alone. `squares`: sum of squared residuals, may be null.
Decay fit_decay(std::span<const double> t_s, std::span<const double> y, const Interval& interval, double tau_s,
                double* squares = nullptr);

struct SignalFit {
  double tau_s = 0.0;
  double sigma = 0.0;              // rms of the residual, corrected for degrees of freedom
  double information = 0.0;        // of ln tau, in units of 1 / y^2: the variance of ln tau is sigma^2 / information
  double interval_variance = 0.0;  // of ln tau, from differences between intervals (sandwich estimator)
  double effective_intervals = 0.0;
  std::vector<Interval> intervals;  // all, in order
  std::vector<Decay> decays;        // one per interval
  double contrast = 0.0;            // between the 5th and the 95th percentile of the signal
  std::size_t informative_samples = 0;
};

// Fits cut and tau of a signal, both unknown. Nothing when no tau fits. Thread: any.
std::optional<SignalFit> fit_signal(std::span<const double> t_s, std::span<const double> y);

// Refits tau and its errors with the cut held fixed, by Gauss-Newton (variable projection). Thread: any.
void refit(std::span<const double> t_s, std::span<const double> y, SignalFit& fit);

// Switching time between two consecutive curves: their intersection in [from_s, to_s], if any. Thread: any.
std::optional<double> crossing(const Decay& before, const Decay& after, double tau_s, double from_s, double to_s);

struct CommonSignal {
  std::vector<std::int8_t> follows;  // of each pixel of the frame: 1: responds, -1: inverted, 0: not at all
  std::vector<double> mean;          // one value per frame: mean of the responding pixels, inverted ones negated
  std::vector<float> deviation;      // of each pixel: rms about its own mean
  std::size_t pixels = 0;            // responding
  double clipped_share = 0.0;        // of the responding pixels: at the end of 16 bits, or piled up at one level
};

// Finds the strongest common shape on a grid of pixels (power iteration), each scaled by its own deviation so that none
// dominates, then correlates every pixel of the frame with it. kBadInput without a common shape, or for values that are
// not finite. Thread: setup.
Result<CommonSignal> find_common_signal(const FrameSeries& frames, const Progress& progress);

// Regressors of every interval, for a range of taus around a middle one.
class DecayTable {
 public:
  static constexpr int kNodes = 61;
  static constexpr int kMiddle = kNodes / 2;
  static constexpr double kNodeStep = 0.02;  // of ln tau

  // Uses the intervals of at least kLeastCount samples.
  DecayTable(const std::vector<double>& t_s, const std::vector<Interval>& intervals, double middle_tau_s);

  const Regressors& at(std::size_t interval, int node) const {
    return regressors_[interval * kNodes + static_cast<std::size_t>(node)];
  }
  double tau_s(int node) const;
  const std::vector<Interval>& intervals() const { return intervals_; }

 private:
  double middle_tau_s_;
  std::vector<Interval> intervals_;
  std::vector<Regressors> regressors_;
};

// Estimates of each pixel of the frame after a pass.
struct PixelTaus {
  std::vector<std::int8_t> node;  // node of DecayTable that the pass used
  std::vector<float> tau_s;
  std::vector<float> error;    // standard error of ln tau; infinite if unknown
  std::vector<float> sigma;    // rms of the residual
  std::vector<float> delay_s;  // delay of the pixel's switches after the mean signal's; NaN: unknown
  // Of ln tau common to all pixels: its Gauss-Newton step is score / information, its variance score2 / information^2.
  double score = 0.0;
  double score2 = 0.0;
  double information = 0.0;
};

// A switch of the mean signal between intervals `before` and `before` + 1 of the table.
struct SwitchBetween {
  std::size_t before = 0;
  double t_s = 0.0;
  double from_s = 0.0;  // search range of a pixel's own switch
  double to_s = 0.0;
};

// One pass over the frames. `taus.node`: each pixel's node (empty: the middle one); the next pass uses nearest_nodes().
// Thread: setup.
Status pass(const FrameSeries& frames, const DecayTable& table, const std::vector<SwitchBetween>& switches,
            const std::vector<std::int8_t>& follows, PixelTaus& taus, const Progress& progress);

// Indices of the responding pixels.
std::vector<std::size_t> following(const std::vector<std::int8_t>& follows);

std::vector<std::int8_t> nearest_nodes(const DecayTable& table, const PixelTaus& taus);

// A plane fitted to the pixels' delays, s.
struct Sweep {
  Eigen::Vector3d delay = Eigen::Vector3d::Zero();  // at the middle; edge to edge along x; along y
  Eigen::Vector3d error = Eigen::Vector3d::Zero();
  double low() const { return delay[0] - (std::abs(delay[1]) + std::abs(delay[2])) / 2.0; }
  double high() const { return delay[0] + (std::abs(delay[1]) + std::abs(delay[2])) / 2.0; }
};

// From the delays of the last pass. Thread: any.
Sweep fit_sweep(const FrameSeries& frames, const PixelTaus& taus, double tau_s);

// Switches of the mean signal between neighbouring intervals of the table. A pixel's own switch is searched up to
// `reach_s` beyond the samples on either side. Thread: any.
std::vector<SwitchBetween> between(const FrameSeries& frames, const DecayTable& table, const SignalFit& fit,
                                   double reach_s);

// Removes samples taken while any pixel's input switches. Thread: any.
void trim(const FrameSeries& frames, const std::vector<SwitchBetween>& switches, const DecayTable& table,
          const Sweep& sweep, SignalFit& fit);

// Switching times and levels of the mean signal's input. Thread: any.
void describe_switches(std::span<const double> t_s, const SignalFit& signal, PulseFit& fit);

// Measured and simulated values of one pixel. `signal` supplies the intervals; levels and amplitudes are the pixel's
// own. Thread: setup.
Status show_pixel(const FrameSeries& frames, const SignalFit& signal, const PixelTaus& taus,
                  const std::vector<std::size_t>& pixels, PixelTrace& trace);

}  // namespace bolo::diagnose

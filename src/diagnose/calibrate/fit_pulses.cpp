// tau from pulses: the common signal first, then pixel by pixel.
#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>

#include "src/core/statistics.hpp"
#include "src/diagnose/calibrate/pulses.hpp"
#include "src/diagnose/session.hpp"
#include "src/report/text.hpp"

namespace bolo::diagnose {
namespace {

constexpr double kMostClipped = 0.2;      // of the pixels that follow
constexpr double kLeastExplained = 0.98;  // of the mean signal's variance, by curves between switches
constexpr double kLeastUsed = 0.4;        // of the frames, in intervals long enough to tell tau
constexpr double kWorstError = 0.1;       // of tau
constexpr double kTooFast = 0.5;          // of a frame period: a tau below it is hardly seen
constexpr double kMostLeft = 0.35;        // of a pixel's deviation, that curves may leave
constexpr double kLeastGap = 0.7;         // below it, intervals follow the noise
constexpr double kMapError = 0.05;        // median error of a pixel's tau, below which pixels are taken one by one
constexpr double kLeastSpread = 1e-3;     // of tau
constexpr double kSignificant = 4.0;      // standard errors

using plot::format;

// Student's quantile for a two-sided 95 % interval (Cornish and Fisher's expansion; within 1 % from 3 degrees on).
double student(double degrees) {
  constexpr double z = 1.959964;
  const double v = std::max(1.5, degrees);
  return z + (z * z * z + z) / (4.0 * v) + (5.0 * std::pow(z, 5) + 16.0 * z * z * z + 3.0 * z) / (96.0 * v * v) +
         (3.0 * std::pow(z, 7) + 19.0 * std::pow(z, 5) + 17.0 * z * z * z - 15.0 * z) / (384.0 * v * v * v);
}

double period_of(const FrameSeries& frames) { return median(gaps_of(frames.t_s)); }

// Whether curves between switches are what the mean signal is made of.
Status check(const FrameSeries& frames, const CommonSignal& common, const std::optional<SignalFit>& fit) {
  if (common.clipped_share > kMostClipped) {
    return bad_input(frames.name +
                     format(": %.0f %% of the pixels that see the pulses are clipped; lower the level, or choose "
                            "another temperature range",
                            100.0 * common.clipped_share));
  }
  const auto no_pulses = [&](const std::string& why) {
    return bad_input(frames.name + ": no rectangular pulses: " + why);
  };
  if (!fit) return no_pulses("nothing in it decays as a pixel does; record a chopper or a switched board");
  std::vector<Interval> telling = fit->intervals;
  std::erase_if(telling, [](const Interval& i) { return i.count < kLeastCount; });
  if (telling.size() < 2) {
    return no_pulses("its pixels see nothing switch for " + std::to_string(kLeastCount) +
                     " frames or more; record longer pulses");
  }
  const auto n = static_cast<double>(frames.t_s.size());
  const double mean = sum_of(common.mean) / n;
  const double variance = sum_of(common.mean, [=](double y) { return (y - mean) * (y - mean) / n; });
  const double explained = 1.0 - fit->sigma * fit->sigma / variance;
  if (explained < kLeastExplained || static_cast<double>(fit->informative_samples) < kLeastUsed * n) {
    return no_pulses("what its pixels have in common changes all the time; record a chopper or a switched board");
  }
  const double variance_of_log =
      fit->information > 0.0 ? std::max(fit->sigma * fit->sigma / fit->information, fit->interval_variance) : 1.0;
  const bool vague = !(std::sqrt(variance_of_log) < kWorstError);
  const double period_s = period_of(frames);
  if (vague && fit->tau_s < kTooFast * period_s) {
    return bad_input(frames.name +
                     format(": a frame every %.1f ms doesn't tell tau: after a switch the next frame shows the "
                            "new level already; record at a higher frame rate",
                            1e3 * period_s));
  }
  // Where tau is real, some interval lasts long enough to come near its level.
  const auto lasting = std::ranges::count_if(
      telling, [&](const Interval& i) { return frames.t_s[i.end() - 1] - frames.t_s[i.first] > 1.5 * fit->tau_s; });
  if (vague || lasting < 2) {
    return no_pulses(
        "what its pixels have in common decays nowhere in the same way twice; record a chopper or "
        "a switched board");
  }
  return {};
}

// Whether each pixel is what the mean is.
Status check_pixels(const FrameSeries& frames, const CommonSignal& common, const PixelTaus& taus) {
  const double left = median(mapped(following(common.follows), [&](std::size_t p) {
    return static_cast<double>(taus.sigma[p] / common.deviation[p]);
  }));
  if (left < kMostLeft) return {};
  return bad_input(frames.name +
                   ": no rectangular pulses: its pixels have little more in common than noise; record a "
                   "higher contrast, or hold the camera still before a chopper");
}

// The interval of tau: what differs between pixels, and what all pixels share at a time (flicker, a level that drifts),
// which shows as a difference between intervals.
Estimate tau_estimate(double tau_s, double pixel_error, double noise_error, const SignalFit& fit, double bias) {
  const double shared2 = std::max(0.0, fit.interval_variance - noise_error * noise_error);
  const double error2 = pixel_error * pixel_error + shared2;
  const double share = shared2 / std::max(error2, 1e-300);
  const double degrees = share > 1e-6 ? (fit.effective_intervals - 1.0) / (share * share) : 1e9;
  const double half = student(degrees) * std::sqrt(error2) + bias;
  return {tau_s, tau_s * (1.0 - half), tau_s * (1.0 + half)};
}

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

// When the mean signal's input switched, and to which levels.
void describe_switches(std::span<const double> t_s, const SignalFit& signal, PulseFit& fit) {
  const std::vector<Piece> pieces = pieces_of(t_s, signal.intervals, signal.decays, signal.tau_s, signal.contrast);
  for (std::size_t i = 0; i < pieces.size(); ++i) {
    if (pieces[i].goes_on) continue;
    fit.levels_k.push_back(pieces[i].count >= 3 ? pieces[i].decay.level : kNone);
    if (i + 1 < pieces.size()) fit.switches_s.push_back(pieces[i].to_s - t_s.front());
  }
}

// The pixel nearest to the middle of the frame among those whose tau is known as well as that of most.
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

// Measured and simulated values of one pixel. `signal` has the intervals; levels and amplitudes are the pixel's own.
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
  // Samples of no interval, or of one that has none to spare, are not compared.
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

// The steps of one fit, in their order; what one leaves the next ones use.
class PulseFitter {
 public:
  PulseFitter(const FrameSeries& frames, CommonSignal common, SignalFit signal, const Progress& progress)
      : frames_(frames),
        common_(std::move(common)),
        follows_(common_.follows),
        signal_(std::move(signal)),
        progress_(progress),
        table_(frames.t_s, signal_.intervals, signal_.tau_s) {}

  Result<PulseFit> run() {
    describe_switches(frames_.t_s, signal_, fit_);
    for (const auto step : {&PulseFitter::find_sweep, &PulseFitter::share_tau, &PulseFitter::take_pixels_one_by_one,
                            &PulseFitter::judge_residual}) {
      RETURN_IF_ERROR((this->*step)());
    }
    return std::move(fit_);
  }

 private:
  Status pass_with(std::vector<std::int8_t> nodes) {
    taus_.node = std::move(nodes);
    Status done = pass(frames_, table_, switches_, follows_, taus_, progress_);
    if (done) settle_errors(table_, follows_, taus_);
    return done;
  }

  // Where the switches run over the frame; the samples that they spoil go.
  Status find_sweep() {
    const double period_s = period_of(frames_);
    switches_ = between(frames_, table_, signal_, period_s);
    RETURN_IF_ERROR(pass_with({}));
    const Sweep sweep = fit_sweep(frames_, taus_, signal_.tau_s);
    trim(frames_, switches_, table_, sweep, signal_);
    refit(frames_.t_s, common_.mean, signal_);
    table_ = DecayTable(frames_.t_s, signal_.intervals, signal_.tau_s);
    if (table_.intervals().size() < 2) {
      return bad_input(frames_.name +
                       ": no rectangular pulses: the switches take as long as the pulses; record longer ones");
    }
    switches_ = between(frames_, table_, signal_, period_s + sweep.high() - sweep.low());
    return {};
  }

  // All good pixels together, as if they shared one tau: no pixel's error is in it, but the curvature of their spread
  // is.
  Status share_tau() {
    RETURN_IF_ERROR(pass_with({}));
    RETURN_IF_ERROR(check_pixels(frames_, common_, taus_));
    fit_.dead = find_dead(frames_, common_, taus_);
    for (std::size_t p = 0; p < follows_.size(); ++p) {
      if (fit_.dead[p] != DeadPixel::kGood) follows_[p] = 0;
    }
    if (follows_ != common_.follows) {
      RETURN_IF_ERROR(pass_with({}));
    }
    usual_error_ = median(mapped(following(follows_), [this](std::size_t p) { return taus_.error[p]; }));
    if (!(taus_.information > 0.0)) return bad_input(frames_.name + ": no pixel tells tau; record a higher contrast");
    const double tau_s = signal_.tau_s * std::exp(std::clamp(taus_.score / taus_.information, -0.3, 0.3));
    const double error = std::sqrt(taus_.score2) / taus_.information;
    fit_.tau_s = tau_estimate(tau_s, error, error, signal_, 0.0);
    return {};
  }

  Status take_pixels_one_by_one() {
    const bool each = usual_error_ < kMapError;
    for (int round = 0; each && round < 2; ++round) {
      RETURN_IF_ERROR(pass_with(nearest_nodes(table_, taus_)));
    }
    pixels_ = trusted(taus_, fit_.dead);
    if (!each || pixels_.empty()) return {};
    const Population all = population(taus_, pixels_);
    fit_.spread_significant = all.spread_z > kSignificant && all.spread > kLeastSpread;
    if (!fit_.spread_significant) return {};
    fit_.tau_spread = all.spread;
    fit_.tau_map_s = shrunk_map(taus_, pixels_, all);
    // What is nonlinear in a pixel's error shifts the mean by some of its square.
    fit_.tau_s = tau_estimate(all.mean_s, all.error, all.noise_error, signal_, 0.5 * usual_error_ * usual_error_);
    return {};
  }

  Status judge_residual() {
    const Sweep sweep = fit_sweep(frames_, taus_, fit_.tau_s.value);
    fit_.sweep_x_s = interval(sweep.delay[1], sweep.error[1]);
    fit_.sweep_y_s = interval(sweep.delay[2], sweep.error[2]);
    fit_.rmse_k = rms_left(taus_, pixels_);
    ASSIGN_OR_RETURN(fit_.noise_k, late_noise(frames_, table_, taus_, pixels_, progress_));
    fit_.gap = fit_.noise_k > 0.0 ? fit_.rmse_k / fit_.noise_k : 1.0;
    if (fit_.gap < kLeastGap && fit_.noise_k > frames_.step) {
      return bad_input(frames_.name +
                       ": no rectangular pulses: its intervals are too short for their number; record longer pulses");
    }
    fit_.intervals = table_.intervals().size();
    fit_.pixels = common_.pixels;
    return show_pixel(frames_, signal_, taus_, pixels_, fit_.trace);
  }

  const FrameSeries& frames_;
  CommonSignal common_;
  std::vector<std::int8_t> follows_;  // those of common_ that are not dead
  SignalFit signal_;
  const Progress& progress_;
  DecayTable table_;
  std::vector<SwitchBetween> switches_;
  PixelTaus taus_;
  std::vector<std::size_t> pixels_;  // that are trusted
  double usual_error_ = 0.0;         // of a pixel's ln tau
  PulseFit fit_;
};

}  // namespace

Result<PulseFit> fit_pulses(const FrameSeries& frames, const Progress& progress) {
  if (frames.t_s.size() < kFewestFrames) {
    return bad_input(frames.name + ": has " + std::to_string(frames.t_s.size()) + " frames; at least " +
                     std::to_string(kFewestFrames) + " with several switches are needed");
  }
  ASSIGN_OR_RETURN(auto common, find_common_signal(frames, progress));
  std::optional<SignalFit> signal = fit_signal(frames.t_s, common.mean);
  RETURN_IF_ERROR(check(frames, common, signal));
  return PulseFitter(frames, std::move(common), std::move(*signal), progress).run();
}

}  // namespace bolo::diagnose

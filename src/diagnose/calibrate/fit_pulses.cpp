// tau from pulses: first from the common signal, then pixel by pixel.
#include "src/diagnose/calibrate/pulses.hpp"
#include "src/diagnose/session.hpp"
#include "src/report/text.hpp"

namespace bolo::diagnose {
namespace {

constexpr double kMostClipped = 0.2;      // of the responding pixels
constexpr double kLeastExplained = 0.98;  // of the mean signal's variance, explained by curves between switches
constexpr double kLeastUsed = 0.4;        // of the frames, in intervals long enough for tau
constexpr double kWorstError = 0.1;       // largest relative error of tau
constexpr double kTooFast = 0.5;          // of a frame period: a smaller tau is hardly observable
constexpr double kMostLeft = 0.35;        // largest residual of the curves, in a pixel's deviation
constexpr double kLeastGap = 0.7;         // of residual to noise: below it, intervals overfit the noise
constexpr double kMapError = 0.05;        // of a pixel's tau: pixels are fitted individually below this median error
constexpr double kLeastSpread = 1e-3;     // of tau
constexpr double kSignificant = 4.0;      // standard errors

// Limits set on simulated choppers with and without dead pixels and spread (tests/diagnose/calibrate_test.cpp).
constexpr double kPrior = 200.0;       // weight of the median noise beside a pixel's own, frames
constexpr double kMostError = 4.0;     // largest standard error of a trusted pixel, times the median
constexpr double kMostScatters = 6.0;  // largest deviation of a trusted pixel, in scatters of the taus
constexpr double kNoisyPixel = 4.0;    // times the median residual, and
constexpr double kNoisySwing = 0.003;  // of the median deviation, which allows for model errors
constexpr double kWeakPixel = 0.15;    // of the median deviation
constexpr double kLoudPixel = 0.5;     // of the median deviation, for a pixel that does not respond

using plot::format;

// Student's quantile for a two-sided 95 % interval (Cornish-Fisher expansion; within 1 % from 3 degrees of freedom).
double student(double degrees) {
  constexpr double z = 1.959964;
  const double v = std::max(1.5, degrees);
  return z + (z * z * z + z) / (4.0 * v) + (5.0 * std::pow(z, 5) + 16.0 * z * z * z + 3.0 * z) / (96.0 * v * v) +
         (3.0 * std::pow(z, 7) + 19.0 * std::pow(z, 5) + 17.0 * z * z * z - 15.0 * z) / (384.0 * v * v * v);
}

double period_of(const FrameSeries& frames) { return median(gaps_of(frames.t_s)); }

// Checks that the mean signal consists of curves between switches.
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
  // With the true tau, intervals last long enough to approach their levels.
  const auto lasting = std::ranges::count_if(
      telling, [&](const Interval& i) { return frames.t_s[i.end() - 1] - frames.t_s[i.first] > 1.5 * fit->tau_s; });
  if (vague || lasting < 2) {
    return no_pulses(
        "what its pixels have in common decays nowhere in the same way twice; record a chopper or "
        "a switched board");
  }
  return {};
}

// Checks that single pixels follow the curves of the mean.
Status check_pixels(const FrameSeries& frames, const CommonSignal& common, const PixelTaus& taus) {
  const double left = median(mapped(following(common.follows), [&](std::size_t p) {
    return static_cast<double>(taus.sigma[p] / common.deviation[p]);
  }));
  if (left < kMostLeft) return {};
  return bad_input(frames.name +
                   ": no rectangular pulses: its pixels have little more in common than noise; record a "
                   "higher contrast, or hold the camera still before a chopper");
}

// Confidence interval of tau. The error that all pixels share (flicker, drift) shows in differences between intervals.
Estimate tau_estimate(double tau_s, double pixel_error, double noise_error, const SignalFit& fit, double bias) {
  const double shared2 = std::max(0.0, fit.interval_variance - noise_error * noise_error);
  const double error2 = pixel_error * pixel_error + shared2;
  const double share = shared2 / std::max(error2, 1e-300);
  const double degrees = share > 1e-6 ? (fit.effective_intervals - 1.0) / (share * share) : 1e9;
  const double half = student(degrees) * std::sqrt(error2) + bias;
  return {tau_s, tau_s * (1.0 - half), tau_s * (1.0 + half)};
}

// A pixel's noise from its residual is inexact in short recordings: shrinks it to the median noise by weight kPrior.
void settle_errors(const DecayTable& table, const std::vector<std::int8_t>& follows, PixelTaus& taus) {
  const double freedom = freedom_of(table.intervals());
  const std::vector<std::size_t> pixels = following(follows);
  const double usual = median(mapped(pixels, [&](std::size_t p) { return taus.sigma[p]; }));
  for (const std::size_t p : pixels) {
    const double sigma = taus.sigma[p];
    if (!(sigma > 0.0)) continue;
    const double settled = std::sqrt((freedom * sigma * sigma + kPrior * usual * usual) / (freedom + kPrior));
    taus.error[p] *= static_cast<float>(settled / sigma);
  }
}

// Pixels whose response is too noisy or too weak, or missing although their neighbours respond.
std::vector<DeadPixel> find_dead(const FrameSeries& frames, const CommonSignal& common, const PixelTaus& taus) {
  std::vector<DeadPixel> dead(frames.geometry.pixels(), DeadPixel::kGood);
  const std::vector<std::size_t> pixels = following(common.follows);
  const double usual = median(mapped(pixels, [&](std::size_t p) { return taus.sigma[p]; }));
  const double swing = median(mapped(pixels, [&](std::size_t p) { return common.deviation[p]; }));
  for (std::size_t p = 0; p < dead.size(); ++p) {
    const double deviation = common.deviation[p];
    if (common.follows[p] != 0) {
      const bool noisy = taus.sigma[p] > kNoisyPixel * usual + kNoisySwing * swing;
      dead[p] = noisy ? DeadPixel::kNoisy : deviation < kWeakPixel * swing ? DeadPixel::kSilent : DeadPixel::kGood;
      continue;
    }
    // No response to the pulses: dead if the neighbours respond, else outside the image of the source.
    const PixelPlace at = place_of(p, frames.geometry.width);
    int seen = 0;
    int follow = 0;
    visit_around(frames.geometry, at, 2, [&](std::size_t other) {
      ++seen;
      follow += common.follows[other] != 0 ? 1 : 0;
    });
    if (4 * follow < 3 * seen) continue;
    dead[p] = deviation <= 0.0                 ? DeadPixel::kFrozen
              : deviation > kLoudPixel * swing ? DeadPixel::kNoisy
                                               : DeadPixel::kSilent;
  }
  return dead;
}

// Good pixels with a small enough standard error, without outliers.
std::vector<std::size_t> trusted(const PixelTaus& taus, const std::vector<DeadPixel>& dead) {
  auto known = places_where(taus.tau_s.size(), [&](std::size_t p) {
    return dead[p] == DeadPixel::kGood && std::isfinite(taus.error[p]) && std::isfinite(taus.tau_s[p]);
  });
  const double usual = median(mapped(known, [&](std::size_t p) { return taus.error[p]; }));
  const double middle = median(mapped(known, [&](std::size_t p) { return taus.tau_s[p]; }));
  const auto away = [&](std::size_t p) { return std::abs(taus.tau_s[p] - middle); };
  const double scatter = std::max(median(mapped(known, away)) / kMadOfSigma, 1e-9 * middle);
  std::erase_if(
      known, [&](std::size_t p) { return !(taus.error[p] < kMostError * usual && away(p) < kMostScatters * scatter); });
  return known;
}

// Mean and spread of the pixels' taus when each has a standard error (random effects, DerSimonian and Laird 1986).
struct Population {
  double mean_s = 0.0;
  double error = 0.0;        // of the mean, relative
  double noise_error = 0.0;  // the part of it due to the pixels' own errors
  double spread = 0.0;       // rms, relative
  double spread_z = 0.0;
};

Population population(const PixelTaus& taus, const std::vector<std::size_t>& pixels) {
  Population all;
  if (pixels.empty()) return all;
  const double middle = median(mapped(pixels, [&](std::size_t p) { return taus.tau_s[p]; }));
  const auto error2 = [&](std::size_t p) { return std::pow(static_cast<double>(taus.error[p]), 2); };
  const auto away = [&](std::size_t p) { return taus.tau_s[p] / middle - 1.0; };
  const auto mean_with = [&](double spread2, double& error) {
    const double weights = sum_of(pixels, [&](std::size_t p) { return 1.0 / (error2(p) + spread2); });
    const double sum = sum_of(pixels, [&](std::size_t p) { return 1.0 / (error2(p) + spread2) * away(p); });
    error = 1.0 / std::sqrt(weights);
    return sum / weights;
  };
  const double fixed = mean_with(0.0, all.noise_error);
  const double q = sum_of(pixels, [&](std::size_t p) { return 1.0 / error2(p) * std::pow(away(p) - fixed, 2); });
  const double w1 = sum_of(pixels, [&](std::size_t p) { return 1.0 / error2(p); });
  const double w2 = sum_of(pixels, [&](std::size_t p) { return 1.0 / error2(p) * (1.0 / error2(p)); });
  const double degrees = static_cast<double>(pixels.size()) - 1.0;
  const double spread2 = std::max(0.0, (q - degrees) / (w1 - w2 / w1));
  all.spread = std::sqrt(spread2);
  all.spread_z = degrees > 0.0 ? (q - degrees) / std::sqrt(2.0 * degrees) : 0.0;
  all.mean_s = middle * (1.0 + mean_with(spread2, all.error));
  return all;
}

// Tau of each trusted pixel, s, shrunk to the mean by its reliability; the mean elsewhere.
std::vector<float> shrunk_map(const PixelTaus& taus, const std::vector<std::size_t>& pixels, const Population& all) {
  std::vector<float> map(taus.tau_s.size(), static_cast<float>(all.mean_s));
  for (const std::size_t p : pixels) {
    const double error2 = std::pow(static_cast<double>(taus.error[p]), 2);
    const double reliability = all.spread * all.spread / (all.spread * all.spread + error2);
    map[p] = static_cast<float>(all.mean_s + reliability * (taus.tau_s[p] - all.mean_s));
  }
  return map;
}

double rms_left(const PixelTaus& taus, const std::vector<std::size_t>& pixels) {
  const double sum = sum_of(pixels, [&](std::size_t p) { return std::pow(static_cast<double>(taus.sigma[p]), 2); });
  return std::sqrt(sum / std::max(1.0, static_cast<double>(pixels.size())));
}

// Noise of the pixels by prediction of each frame from the two before: between switches, L + A exp(-t / tau) cancels in
// (y2 - y1) - r (y1 - y0). Only the late half of each interval is used, where a small error of tau is negligible.
Result<double> late_noise(const FrameSeries& frames, const DecayTable& table, const PixelTaus& taus,
                          const std::vector<std::size_t>& pixels, const Progress& progress) {
  std::array<std::vector<float>, 3> last;
  std::vector<double> squares(pixels.size(), 0.0);
  double count = 0.0;
  for (const Interval& interval : table.intervals()) {
    const std::size_t begin = interval.count >= 8 ? interval.first + interval.count / 2 : interval.first;
    const auto take = [&](std::size_t k, std::span<const float> frame) {
      std::rotate(last.begin(), last.begin() + 1, last.end());
      last[2].assign(frame.begin(), frame.end());
      if (k < begin + 2) return;
      std::array<double, DecayTable::kNodes> ratio{};
      for (int node = 0; node < DecayTable::kNodes; ++node) {
        const double a1 = std::exp(-(frames.t_s[k - 1] - frames.t_s[k - 2]) / table.tau_s(node));
        const double a2 = std::exp(-(frames.t_s[k] - frames.t_s[k - 1]) / table.tau_s(node));
        ratio[static_cast<std::size_t>(node)] = a1 * (1.0 - a2) / (1.0 - a1);
      }
      for (std::size_t i = 0; i < pixels.size(); ++i) {
        const std::size_t p = pixels[i];
        const auto y = [&](std::size_t j) { return static_cast<double>(last[j][p]); };
        const double r = ratio[static_cast<std::uint8_t>(taus.node[p])];
        const double z = (y(2) - y(1)) - r * (y(1) - y(0));
        squares[i] += z * z / (1.0 + (1.0 + r) * (1.0 + r) + r * r);
      }
      count += 1.0;
    };
    RETURN_IF_ERROR(frames.for_each("noise", progress, take, begin, interval.end()));
  }
  if (!(count > 0.0)) return 0.0;
  const double sum = sum_of(squares, [count](double s) { return s / count; });
  return std::sqrt(sum / std::max(1.0, static_cast<double>(pixels.size())));
}

struct PulseFitter {
  const FrameSeries& frames;
  const Progress& progress;
  CommonSignal common;
  SignalFit signal;
  std::vector<std::int8_t> follows = common.follows;  // dead pixels removed
  DecayTable table{frames.t_s, signal.intervals, signal.tau_s};
  std::vector<SwitchBetween> switches{};
  PixelTaus taus{};
  std::vector<std::size_t> pixels{};  // trusted ones
  double usual_error = 0.0;           // of a pixel's ln tau
  PulseFit fit{};

  Result<PulseFit> run() {
    describe_switches(frames.t_s, signal, fit);
    for (const auto step : {&PulseFitter::find_sweep, &PulseFitter::share_tau, &PulseFitter::take_pixels_one_by_one,
                            &PulseFitter::judge_residual}) {
      RETURN_IF_ERROR((this->*step)());
    }
    return std::move(fit);
  }

  Status pass_with(std::vector<std::int8_t> nodes) {
    taus.node = std::move(nodes);
    Status done = pass(frames, table, switches, follows, taus, progress);
    if (done) settle_errors(table, follows, taus);
    return done;
  }

  // Fits the sweep of the switches over the frame, and removes samples within it.
  Status find_sweep() {
    const double period_s = period_of(frames);
    switches = between(frames, table, signal, period_s);
    RETURN_IF_ERROR(pass_with({}));
    const Sweep sweep = fit_sweep(frames, taus, signal.tau_s);
    trim(frames, switches, table, sweep, signal);
    refit(frames.t_s, common.mean, signal);
    table = DecayTable(frames.t_s, signal.intervals, signal.tau_s);
    if (table.intervals().size() < 2) {
      return bad_input(frames.name +
                       ": no rectangular pulses: the switches take as long as the pulses; record longer ones");
    }
    switches = between(frames, table, signal, period_s + sweep.high() - sweep.low());
    return {};
  }

  // One tau for all good pixels: unbiased by errors of single pixels, but biased by the curvature of their spread.
  Status share_tau() {
    RETURN_IF_ERROR(pass_with({}));
    RETURN_IF_ERROR(check_pixels(frames, common, taus));
    fit.dead = find_dead(frames, common, taus);
    for (std::size_t p = 0; p < follows.size(); ++p) {
      if (fit.dead[p] != DeadPixel::kGood) follows[p] = 0;
    }
    if (follows != common.follows) {
      RETURN_IF_ERROR(pass_with({}));
    }
    usual_error = median(mapped(following(follows), [this](std::size_t p) { return taus.error[p]; }));
    if (!(taus.information > 0.0)) return bad_input(frames.name + ": no pixel tells tau; record a higher contrast");
    const double tau_s = signal.tau_s * std::exp(std::clamp(taus.score / taus.information, -0.3, 0.3));
    const double error = std::sqrt(taus.score2) / taus.information;
    fit.tau_s = tau_estimate(tau_s, error, error, signal, 0.0);
    return {};
  }

  Status take_pixels_one_by_one() {
    const bool each = usual_error < kMapError;
    for (int round = 0; each && round < 2; ++round) {
      RETURN_IF_ERROR(pass_with(nearest_nodes(table, taus)));
    }
    pixels = trusted(taus, fit.dead);
    if (!each || pixels.empty()) return {};
    const Population all = population(taus, pixels);
    fit.spread_significant = all.spread_z > kSignificant && all.spread > kLeastSpread;
    if (!fit.spread_significant) return {};
    fit.tau_spread = all.spread;
    fit.tau_map_s = shrunk_map(taus, pixels, all);
    // The mean's bias is of second order in a pixel's error.
    fit.tau_s = tau_estimate(all.mean_s, all.error, all.noise_error, signal, 0.5 * usual_error * usual_error);
    return {};
  }

  Status judge_residual() {
    const Sweep sweep = fit_sweep(frames, taus, fit.tau_s.value);
    fit.sweep_x_s = interval(sweep.delay[1], sweep.error[1]);
    fit.sweep_y_s = interval(sweep.delay[2], sweep.error[2]);
    fit.rmse_k = rms_left(taus, pixels);
    ASSIGN_OR_RETURN(fit.noise_k, late_noise(frames, table, taus, pixels, progress));
    fit.gap = fit.noise_k > 0.0 ? fit.rmse_k / fit.noise_k : 1.0;
    if (fit.gap < kLeastGap && fit.noise_k > frames.step) {
      return bad_input(frames.name +
                       ": no rectangular pulses: its intervals are too short for their number; record longer pulses");
    }
    fit.intervals = table.intervals().size();
    fit.pixels = common.pixels;
    return show_pixel(frames, signal, taus, pixels, fit.trace);
  }
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
  return PulseFitter{frames, progress, std::move(common), std::move(*signal)}.run();
}

}  // namespace bolo::diagnose

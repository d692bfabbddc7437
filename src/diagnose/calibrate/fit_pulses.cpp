// tau from pulses: the common signal first, then pixel by pixel.
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <limits>
#include <numeric>

#include <Eigen/Dense>

#include "bolo/diagnose/calibrate.hpp"
#include "common_signal.hpp"
#include "pixel_fit.hpp"
#include "pulse_trace.hpp"

namespace bolo::diagnose {
namespace {

constexpr std::size_t kFewestFrames = 16;
constexpr double kMostClipped = 0.2;      // of the pixels that follow
constexpr double kLeastExplained = 0.98;  // of the mean signal's variance, by curves between switches
constexpr double kLeastUsed = 0.4;        // of the frames, in intervals long enough to tell tau
constexpr double kWorstError = 0.1;       // of tau
constexpr double kTooFast = 0.5;          // of a frame period: a tau below it is hardly seen
constexpr double kMostLeft = 0.35;        // of a pixel's deviation, that curves may leave
constexpr double kLeastGap = 0.7;         // below it, intervals follow the noise
constexpr double kMapError = 0.05;        // median error of a pixel's tau, below which pixels are taken one by one
constexpr double kSignificant = 4.0;      // standard errors

template <typename... Values>
std::string words(const char* format, Values... values) {
  char text[256];
  std::snprintf(text, sizeof text, format, values...);  // NOLINT: the formats are literals
  return text;
}

double median(std::vector<double> values) {
  if (values.empty()) return std::numeric_limits<double>::infinity();
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

// Student's quantile for a two-sided 95 % interval (Cornish and Fisher's expansion; within 1 % from 3 degrees on).
double student(double degrees) {
  constexpr double z = 1.959964;
  const double v = std::max(1.5, degrees);
  return z + (z * z * z + z) / (4.0 * v) + (5.0 * std::pow(z, 5) + 16.0 * z * z * z + 3.0 * z) / (96.0 * v * v) +
         (3.0 * std::pow(z, 7) + 19.0 * std::pow(z, 5) + 17.0 * z * z * z - 15.0 * z) / (384.0 * v * v * v);
}

double period_of(const FrameSeries& frames) {
  std::vector<double> gaps;
  for (std::size_t k = 1; k < frames.t_s.size(); ++k) gaps.push_back(frames.t_s[k] - frames.t_s[k - 1]);
  return median(std::move(gaps));
}

// Whether curves between switches are what the mean signal is made of.
Status check(const FrameSeries& frames, const CommonSignal& common, const std::optional<SignalFit>& fit) {
  const double period_s = period_of(frames);
  const std::string& name = frames.name;
  if (common.clipped_share > kMostClipped) {
    return bad_input(name + words(": %.0f %% of the pixels that see the pulses are clipped; lower the level, or choose "
                                  "another temperature range",
                                  100.0 * common.clipped_share));
  }
  const std::string none = name + ": no rectangular pulses: ";
  if (!fit) return bad_input(none + "nothing in it decays as a pixel does; record a chopper or a switched board");
  const auto telling = std::ranges::count_if(fit->intervals, [](const Interval& i) { return i.count >= kLeastCount; });
  const auto n = static_cast<double>(frames.t_s.size());
  if (telling < 2) {
    return bad_input(none + "its pixels see nothing switch for " + std::to_string(kLeastCount) +
                     " frames or more; record longer pulses");
  }
  const double mean = std::accumulate(common.mean.begin(), common.mean.end(), 0.0) / n;
  double variance = 0.0;
  for (const double y : common.mean) variance += (y - mean) * (y - mean) / n;
  const double explained = 1.0 - fit->sigma * fit->sigma / variance;
  if (explained < kLeastExplained || static_cast<double>(fit->informative_samples) < kLeastUsed * n) {
    return bad_input(none +
                     "what its pixels have in common changes all the time; record a chopper or a switched board");
  }
  const double variance_of_log =
      fit->information > 0.0 ? std::max(fit->sigma * fit->sigma / fit->information, fit->interval_variance) : 1.0;
  const bool vague = !(std::sqrt(variance_of_log) < kWorstError);
  if (vague && fit->tau_s < kTooFast * period_s) {
    return bad_input(name + words(": a frame every %.1f ms doesn't tell tau: after a switch the next frame shows the "
                                  "new level already; record at a higher frame rate",
                                  1e3 * period_s));
  }
  // Where tau is real, some interval lasts long enough to come near its level.
  const auto lasting = std::ranges::count_if(fit->intervals, [&](const Interval& i) {
    return i.count >= kLeastCount && frames.t_s[i.end() - 1] - frames.t_s[i.first] > 1.5 * fit->tau_s;
  });
  if (vague || lasting < 2) {
    return bad_input(none +
                     "what its pixels have in common decays nowhere in the same way twice; record a chopper or "
                     "a switched board");
  }
  return {};
}

// Whether each pixel is what the mean is.
Status check_pixels(const FrameSeries& frames, const CommonSignal& common, const PixelTaus& taus) {
  std::vector<double> left;
  for (std::size_t p = 0; p < common.follows.size(); ++p) {
    if (common.follows[p] != 0) left.push_back(static_cast<double>(taus.sigma[p] / common.deviation[p]));
  }
  if (median(std::move(left)) < kMostLeft) return {};
  return bad_input(frames.name +
                   ": no rectangular pulses: its pixels have little more in common than noise; record a "
                   "higher contrast, or hold the camera still before a chopper");
}

// A pixel's residual says what its noise is, but roughly in a short recording: the usual noise counts as so many frames
// more.
void settle_errors(const DecayTable& table, const std::vector<std::int8_t>& follows, PixelTaus& taus) {
  constexpr double kPrior = 200.0;
  double freedom = -1.0;
  for (const Interval& interval : table.intervals()) freedom += static_cast<double>(interval.count) - 2.0;
  std::vector<double> sigmas;
  for (std::size_t p = 0; p < follows.size(); ++p) {
    if (follows[p] != 0) sigmas.push_back(static_cast<double>(taus.sigma[p]));
  }
  const double usual = median(std::move(sigmas));
  for (std::size_t p = 0; p < follows.size(); ++p) {
    const auto sigma = static_cast<double>(taus.sigma[p]);
    if (follows[p] == 0 || !(sigma > 0.0)) continue;
    const double settled = std::sqrt((freedom * sigma * sigma + kPrior * usual * usual) / (freedom + kPrior));
    taus.error[p] *= static_cast<float>(settled / sigma);
  }
}

// A plane through the pixels' delays.
struct Sweep {
  Eigen::Vector3d delay = Eigen::Vector3d::Zero();  // at the middle; from edge to edge along x; along y
  Eigen::Vector3d error = Eigen::Vector3d::Zero();
  double low() const { return delay[0] - (std::abs(delay[1]) + std::abs(delay[2])) / 2.0; }
  double high() const { return delay[0] + (std::abs(delay[1]) + std::abs(delay[2])) / 2.0; }
};

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
      return Eigen::Vector3d(1.0, (static_cast<double>(p % width) + 0.5) / across - 0.5,
                             (static_cast<double>(p / width) + 0.5) / down - 0.5);
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

// Samples that some pixel takes while its input is changing belong to no interval.
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

// Mean and spread of the pixels' taus when each has a standard error (random effects, DerSimonian and Laird 1986).
struct Population {
  double mean_s = 0.0;
  double error = 0.0;        // of the mean, relative
  double noise_error = 0.0;  // the share of it that comes from the pixels' errors
  double spread = 0.0;       // rms, relative
  double spread_z = 0.0;
  std::size_t pixels = 0;
};

std::vector<std::size_t> trusted(const PixelTaus& taus, const std::vector<DeadPixel>& dead) {
  std::vector<double> errors;
  std::vector<double> values;
  for (std::size_t p = 0; p < taus.tau_s.size(); ++p) {
    if (dead[p] != DeadPixel::kGood || !std::isfinite(taus.error[p]) || !std::isfinite(taus.tau_s[p])) continue;
    errors.push_back(static_cast<double>(taus.error[p]));
    values.push_back(static_cast<double>(taus.tau_s[p]));
  }
  const double usual = median(errors);
  const double middle = median(values);
  for (double& v : values) v = std::abs(v - middle);
  const double scatter = std::max(median(values) / 0.6745, 1e-9 * middle);
  std::vector<std::size_t> pixels;
  for (std::size_t p = 0; p < taus.tau_s.size(); ++p) {
    if (dead[p] != DeadPixel::kGood || !std::isfinite(taus.error[p]) || !std::isfinite(taus.tau_s[p])) continue;
    const double away = std::abs(static_cast<double>(taus.tau_s[p]) - middle);
    if (static_cast<double>(taus.error[p]) < 4.0 * usual && away < 6.0 * scatter) pixels.push_back(p);
  }
  return pixels;
}

Population population(const PixelTaus& taus, const std::vector<std::size_t>& pixels) {
  Population all;
  all.pixels = pixels.size();
  if (pixels.empty()) return all;
  std::vector<double> values;
  for (const std::size_t p : pixels) values.push_back(static_cast<double>(taus.tau_s[p]));
  const double middle = median(std::move(values));
  const auto mean_with = [&](double spread2, double& error) {
    double weights = 0.0;
    double sum = 0.0;
    for (const std::size_t p : pixels) {
      const double w = 1.0 / (std::pow(static_cast<double>(taus.error[p]), 2) + spread2);
      weights += w;
      sum += w * (static_cast<double>(taus.tau_s[p]) / middle - 1.0);
    }
    error = 1.0 / std::sqrt(weights);
    return sum / weights;
  };
  const double fixed = mean_with(0.0, all.noise_error);
  double q = 0.0;
  double w1 = 0.0;
  double w2 = 0.0;
  for (const std::size_t p : pixels) {
    const double w = 1.0 / std::pow(static_cast<double>(taus.error[p]), 2);
    q += w * std::pow(static_cast<double>(taus.tau_s[p]) / middle - 1.0 - fixed, 2);
    w1 += w;
    w2 += w * w;
  }
  const double degrees = static_cast<double>(pixels.size()) - 1.0;
  const double spread2 = std::max(0.0, (q - degrees) / (w1 - w2 / w1));
  all.spread = std::sqrt(spread2);
  all.spread_z = degrees > 0.0 ? (q - degrees) / std::sqrt(2.0 * degrees) : 0.0;
  all.mean_s = middle * (1.0 + mean_with(spread2, all.error));
  return all;
}

std::vector<DeadPixel> find_dead(const FrameSeries& frames, const CommonSignal& common, const PixelTaus& taus) {
  const std::size_t pixels = frames.geometry.pixels();
  std::vector<DeadPixel> dead(pixels, DeadPixel::kGood);
  std::vector<double> sigmas;
  std::vector<double> deviations;
  for (std::size_t p = 0; p < pixels; ++p) {
    if (common.follows[p] == 0) continue;
    sigmas.push_back(static_cast<double>(taus.sigma[p]));
    deviations.push_back(static_cast<double>(common.deviation[p]));
  }
  const double usual = median(std::move(sigmas));
  const double swing = median(std::move(deviations));
  for (int y = 0; y < frames.geometry.height; ++y) {
    for (int x = 0; x < frames.geometry.width; ++x) {
      const auto at = [&](int column, int row) {
        return static_cast<std::size_t>(row) * static_cast<std::size_t>(frames.geometry.width) +
               static_cast<std::size_t>(column);
      };
      const std::size_t p = at(x, y);
      if (common.follows[p] != 0) {
        const bool noisy = static_cast<double>(taus.sigma[p]) > 4.0 * usual + 0.003 * swing;
        const bool weak = static_cast<double>(common.deviation[p]) < 0.15 * swing;
        dead[p] = noisy ? DeadPixel::kNoisy : weak ? DeadPixel::kSilent : DeadPixel::kGood;
        continue;
      }
      // It says nothing of the pulses: dead when its neighbours do, else it looks elsewhere.
      int seen = 0;
      int follow = 0;
      for (int row = std::max(0, y - 2); row <= std::min(frames.geometry.height - 1, y + 2); ++row) {
        for (int column = std::max(0, x - 2); column <= std::min(frames.geometry.width - 1, x + 2); ++column) {
          if (row == y && column == x) continue;
          ++seen;
          follow += common.follows[at(column, row)] != 0 ? 1 : 0;
        }
      }
      if (4 * follow < 3 * seen) continue;
      const double deviation = static_cast<double>(common.deviation[p]);
      dead[p] = deviation <= 0.0          ? DeadPixel::kFrozen
                : deviation > 0.5 * swing ? DeadPixel::kNoisy
                                          : DeadPixel::kSilent;
    }
  }
  return dead;
}

// Noise of the pixels, from what two frames say about the third: between switches L + A exp(-t / tau) leaves nothing of
// (y2 - y1) - r (y1 - y0). In the late half of each interval, so that a small
// error of tau doesn't count.
Result<double> late_noise(const FrameSeries& frames, const DecayTable& table, const PixelTaus& taus,
                          const std::vector<std::size_t>& pixels, const Progress& progress) {
  std::vector<std::vector<float>> last(3, std::vector<float>(frames.geometry.pixels()));
  std::vector<double> squares(pixels.size(), 0.0);
  double count = 0.0;
  for (const Interval& interval : table.intervals()) {
    const std::size_t begin = interval.count >= 8 ? interval.first + interval.count / 2 : interval.first;
    if (!progress("noise", static_cast<double>(begin) / static_cast<double>(frames.t_s.size()))) {
      return failed("interrupted");
    }
    for (std::size_t k = begin; k < interval.end(); ++k) {
      std::rotate(last.begin(), last.begin() + 1, last.end());
      if (Status read = frames.read(k, last[2]); !read) return tl::unexpected(read.error());
      if (k < begin + 2) continue;
      std::array<double, DecayTable::kNodes> ratio{};
      for (int node = 0; node < DecayTable::kNodes; ++node) {
        const double a1 = std::exp(-(frames.t_s[k - 1] - frames.t_s[k - 2]) / table.tau_s(node));
        const double a2 = std::exp(-(frames.t_s[k] - frames.t_s[k - 1]) / table.tau_s(node));
        ratio[static_cast<std::size_t>(node)] = a1 * (1.0 - a2) / (1.0 - a1);
      }
      for (std::size_t i = 0; i < pixels.size(); ++i) {
        const std::size_t p = pixels[i];
        const auto y = [&](std::size_t j) { return static_cast<double>(last[j][p]); };
        const double r = ratio[static_cast<std::size_t>(taus.node[p])];
        const double z = (y(2) - y(1)) - r * (y(1) - y(0));
        squares[i] += z * z / (1.0 + (1.0 + r) * (1.0 + r) + r * r);
      }
      count += 1.0;
    }
  }
  if (!(count > 0.0)) return 0.0;
  double sum = 0.0;
  for (const double s : squares) sum += s / count;
  return std::sqrt(sum / std::max<double>(1.0, static_cast<double>(pixels.size())));
}

double rms_left(const PixelTaus& taus, const std::vector<std::size_t>& pixels) {
  double sum = 0.0;
  for (const std::size_t p : pixels) sum += std::pow(static_cast<double>(taus.sigma[p]), 2);
  return std::sqrt(sum / std::max<double>(1.0, static_cast<double>(pixels.size())));
}

std::vector<float> shrunk_map(const PixelTaus& taus, const std::vector<std::size_t>& pixels, const Population& all) {
  std::vector<float> map(taus.tau_s.size(), static_cast<float>(all.mean_s));
  for (const std::size_t p : pixels) {
    const double error2 = std::pow(static_cast<double>(taus.error[p]), 2);
    const double reliability = all.spread * all.spread / (all.spread * all.spread + error2);
    map[p] = static_cast<float>(all.mean_s + reliability * (static_cast<double>(taus.tau_s[p]) - all.mean_s));
  }
  return map;
}

Estimate sweep_estimate(const Sweep& sweep, int axis) {
  return {sweep.delay[axis], sweep.delay[axis] - 1.96 * sweep.error[axis],
          sweep.delay[axis] + 1.96 * sweep.error[axis]};
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

}  // namespace

Result<PulseFit> fit_pulses(const FrameSeries& frames, const Progress& progress) {
  if (frames.t_s.size() < kFewestFrames) {
    return bad_input(frames.name + ": has " + std::to_string(frames.t_s.size()) + " frames; at least " +
                     std::to_string(kFewestFrames) + " with several switches are needed");
  }
  const auto common = find_common_signal(frames, progress);
  if (!common) return tl::unexpected(common.error());
  std::optional<SignalFit> first = fit_signal(frames.t_s, common->mean);
  if (Status good = check(frames, *common, first); !good) return tl::unexpected(good.error());
  SignalFit& signal = *first;
  PulseFit fit;
  describe_switches(frames.t_s, signal, fit);

  // Where the switches run over the frame, and which samples they spoil.
  const double period_s = period_of(frames);
  PixelTaus taus;
  DecayTable table(frames.t_s, signal.intervals, signal.tau_s);
  std::vector<SwitchBetween> switches = between(frames, table, signal, period_s);
  if (Status done = pass(frames, table, switches, common->follows, taus, progress); !done) {
    return tl::unexpected(done.error());
  }
  Sweep sweep = fit_sweep(frames, taus, signal.tau_s);
  trim(frames, switches, table, sweep, signal);
  refit(frames.t_s, common->mean, signal);
  table = DecayTable(frames.t_s, signal.intervals, signal.tau_s);
  if (table.intervals().size() < 2) {
    return bad_input(frames.name +
                     ": no rectangular pulses: the switches take as long as the pulses; record longer ones");
  }
  switches = between(frames, table, signal, period_s + sweep.high() - sweep.low());
  const auto again = [&](std::vector<std::int8_t> nodes) {
    taus.node = std::move(nodes);
    Status done = pass(frames, table, switches, common->follows, taus, progress);
    settle_errors(table, common->follows, taus);
    return done;
  };
  if (Status done = again({}); !done) return tl::unexpected(done.error());

  if (Status good = check_pixels(frames, *common, taus); !good) return tl::unexpected(good.error());
  fit.dead = find_dead(frames, *common, taus);
  std::vector<double> errors;
  for (std::size_t p = 0; p < taus.error.size(); ++p) {
    if (common->follows[p] != 0) errors.push_back(static_cast<double>(taus.error[p]));
  }
  const double usual_error = median(std::move(errors));
  // All pixels together, as if they shared one tau: no pixel's error is in it, but the curvature of their spread is.
  const double shared_tau_s = signal.tau_s * std::exp(std::clamp(taus.score / taus.information, -0.3, 0.3));
  const double shared_error = std::sqrt(taus.score2) / taus.information;
  Population all;
  std::vector<std::size_t> pixels;
  if (usual_error < kMapError) {
    for (int round = 0; round < 2; ++round) {
      if (Status done = again(nearest_nodes(table, taus)); !done) return tl::unexpected(done.error());
    }
    fit.dead = find_dead(frames, *common, taus);
    pixels = trusted(taus, fit.dead);
    all = population(taus, pixels);
    fit.spread_significant = all.spread_z > kSignificant && all.spread > 1e-3;
    if (fit.spread_significant) {
      fit.tau_spread = all.spread;
      fit.tau_map_s = shrunk_map(taus, pixels, all);
    }
  } else {
    pixels = trusted(taus, fit.dead);
  }
  if (fit.spread_significant) {  // what is nonlinear in a pixel's error shifts the mean by some of its square
    fit.tau_s = tau_estimate(all.mean_s, all.error, all.noise_error, signal, 0.5 * usual_error * usual_error);
  } else {
    fit.tau_s = tau_estimate(shared_tau_s, shared_error, shared_error, signal, 0.0);
  }
  sweep = fit_sweep(frames, taus, fit.tau_s.value);
  fit.sweep_x_s = sweep_estimate(sweep, 1);
  fit.sweep_y_s = sweep_estimate(sweep, 2);
  fit.rmse_k = rms_left(taus, pixels);
  const auto noise_k = late_noise(frames, table, taus, pixels, progress);
  if (!noise_k) return tl::unexpected(noise_k.error());
  fit.noise_k = *noise_k;
  fit.gap = fit.noise_k > 0.0 ? fit.rmse_k / fit.noise_k : 1.0;
  if (fit.gap < kLeastGap && fit.noise_k > frames.step) {
    return bad_input(frames.name +
                     ": no rectangular pulses: its intervals are too short for their number; record "
                     "longer pulses");
  }
  fit.intervals = table.intervals().size();
  fit.pixels = common->pixels;
  auto trace = trace_pixel(frames, signal, taus, pixels);
  if (!trace) return tl::unexpected(trace.error());
  fit.trace = std::move(*trace);
  return fit;
}

}  // namespace bolo::diagnose

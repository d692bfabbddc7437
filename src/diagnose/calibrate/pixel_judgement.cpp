// Judging the pixels of a fit, and how the switches run over the frame.
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

#include <Eigen/Dense>

#include "src/core/statistics.hpp"
#include "src/diagnose/calibrate/pulses.hpp"
#include "src/diagnose/session.hpp"

namespace bolo::diagnose {
namespace {

// All limits are set by simulated choppers with and without dead pixels and spread (tests/diagnose/calibrate_test.cpp).
constexpr double kPrior = 200.0;          // frames, as which the usual noise counts beside a pixel's own
constexpr double kMostError = 4.0;        // times the usual standard error of a pixel that is trusted
constexpr double kMostScatters = 6.0;     // of the taus, that a trusted one may lie off the middle
constexpr double kNoisyPixel = 4.0;       // times the usual residual, and
constexpr double kNoisySwing = 0.003;     // of the usual deviation, for what the model is off by
constexpr double kWeakPixel = 0.15;       // of the usual deviation
constexpr double kLoudPixel = 0.5;        // the same, of a pixel that does not follow
constexpr double kFarDelay = 4.0;         // scatters: an edge that was taken for its neighbour
constexpr double kSwitchMargin_s = 1e-4;  // beyond the sweep, that samples must keep from a switch, and
constexpr double kSweepMargin = 0.05;     // of the sweep

}  // namespace

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

std::vector<std::size_t> trusted(const PixelTaus& taus, const std::vector<DeadPixel>& dead) {
  std::vector<std::size_t> known;
  for (std::size_t p = 0; p < taus.tau_s.size(); ++p) {
    if (dead[p] == DeadPixel::kGood && std::isfinite(taus.error[p]) && std::isfinite(taus.tau_s[p])) known.push_back(p);
  }
  const double usual = median(mapped(known, [&](std::size_t p) { return taus.error[p]; }));
  const double middle = median(mapped(known, [&](std::size_t p) { return taus.tau_s[p]; }));
  const auto away = [&](std::size_t p) { return std::abs(taus.tau_s[p] - middle); };
  const double scatter = std::max(median(mapped(known, away)) / kMadOfSigma, 1e-9 * middle);
  std::erase_if(
      known, [&](std::size_t p) { return !(taus.error[p] < kMostError * usual && away(p) < kMostScatters * scatter); });
  return known;
}

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
    // It says nothing of the pulses: dead when its neighbours do, else it looks elsewhere.
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

double rms_left(const PixelTaus& taus, const std::vector<std::size_t>& pixels) {
  const double sum = sum_of(pixels, [&](std::size_t p) { return std::pow(static_cast<double>(taus.sigma[p]), 2); });
  return std::sqrt(sum / std::max(1.0, static_cast<double>(pixels.size())));
}

std::vector<float> shrunk_map(const PixelTaus& taus, const std::vector<std::size_t>& pixels, const Population& all) {
  std::vector<float> map(taus.tau_s.size(), static_cast<float>(all.mean_s));
  for (const std::size_t p : pixels) {
    const double error2 = std::pow(static_cast<double>(taus.error[p]), 2);
    const double reliability = all.spread * all.spread / (all.spread * all.spread + error2);
    map[p] = static_cast<float>(all.mean_s + reliability * (taus.tau_s[p] - all.mean_s));
  }
  return map;
}

Sweep fit_sweep(const FrameSeries& frames, const PixelTaus& taus, double tau_s) {
  Sweep sweep;
  std::vector<std::size_t> pixels;  // whose delay is known
  for (std::size_t p = 0; p < taus.delay_s.size(); ++p) {
    if (std::isfinite(taus.delay_s[p])) pixels.push_back(p);
  }
  const auto place = [&](std::size_t p) {
    const PixelPlace at = place_of(p, frames.geometry.width);
    return Eigen::Vector3d(1.0, (at.x + 0.5) / frames.geometry.width - 0.5,
                           (at.y + 0.5) / frames.geometry.height - 0.5);
  };
  const auto left = [&](std::size_t p) { return taus.delay_s[p] - place(p).dot(sweep.delay); };
  double scatter = std::numeric_limits<double>::infinity();
  for (int round = 0; round < 3; ++round) {  // what is far off, such as an edge taken for its neighbour, goes
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

}  // namespace bolo::diagnose

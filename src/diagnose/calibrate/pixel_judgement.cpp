#include "pixel_judgement.hpp"

#include <algorithm>
#include <array>
#include <cmath>

#include "statistics.hpp"

namespace bolo::diagnose {

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
  values.reserve(pixels.size());
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
        const double r = ratio[static_cast<std::uint8_t>(taus.node[p])];
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

}  // namespace bolo::diagnose
